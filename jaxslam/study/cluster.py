"""A study on a Dask cluster: workers pull trials from the same storage."""

import logging
import threading
from collections.abc import Callable
from pathlib import Path
from urllib.parse import urlparse

from dask.distributed import Client, KilledWorker, LocalCluster, as_completed

from jaxslam.study.plan import Plan
from jaxslam.study.search import Told, check_hope, keep_programs, run_batch
from jaxslam.study.storage import Store, open_study

CONNECT = 10
"""Seconds to wait for a scheduler."""
RETRIES = 5
"""How often a task begins anew whose worker died."""

_ONE_AT_A_TIME = threading.Lock()
"""A process computes on all of its devices: threads of one worker take turns."""


def run_on_cluster(
    plan: Plan, url: str, cluster: str, programs: Path, on_trial: Callable[[Store, Told], None]
) -> Store:
    """As `run_trials`, on workers elsewhere.

    A worker that is killed loses its trial only: the scheduler gives the task to another one, which asks for
    a new trial.

    Args:
        plan: of the study.
        url: of the storage, which all workers must reach.
        cluster: address of a scheduler (`tcp://host:8786`), or `local:N` for N processes of this machine.
        programs: folder for compiled programs.
        on_trial: called here for every trial that ends.

    Raises:
        ValueError: the cluster cannot be reached, a SQLite file is given to another machine's, or the first
            trials all fail.
    """
    local = _local_workers(cluster)
    host = urlparse(cluster).hostname
    if local is None and url.startswith("sqlite") and host not in ("localhost", "127.0.0.1"):
        raise ValueError(
            f"{url} is a file of this machine, which the workers of {cluster} cannot share: give --storage a "
            "database that they reach, such as postgresql://user@host/studies"
        )
    store = open_study(plan, url)
    with _client(cluster, local) as client:
        done, begun = len(store.finished()), len(store.trials())
        tasks = -(-max(plan.trials - done, 0) // plan.batch)
        futures = [
            client.submit(
                _one_batch, plan, url, begun + index, str(programs), pure=False, retries=RETRIES, key=None
            )
            for index in range(tasks)
        ]
        try:
            for future in as_completed(futures):
                for told in _result(future):
                    on_trial(store, told)
                check_hope(store)
        finally:
            client.cancel(futures)
            if local is not None:
                client.cluster.close()
    return store


def _one_batch(plan: Plan, url: str, stream: int, programs: str) -> list[Told]:
    with _ONE_AT_A_TIME:
        keep_programs(Path(programs))
        store = open_study(plan, url, stream)
        left = plan.trials - len(store.finished())
        return run_batch(plan, store, min(plan.batch, left)) if left > 0 else []


def _result(future) -> list[Told]:
    try:
        return future.result()
    except KilledWorker as error:
        raise ValueError(f"{RETRIES} workers died of the same trial: {error}") from None


def _local_workers(cluster: str) -> int | None:
    if not cluster.startswith("local"):
        return None
    _, _, count = cluster.partition(":")
    if not (count or "2").isdigit() or int(count or "2") < 1:
        raise ValueError(
            f"--cluster is {cluster!r}: give local:N, with N processes, or a scheduler's address"
        )
    return int(count or "2")


def _client(cluster: str, local: int | None) -> Client:
    if local is not None:
        # Their logs are of those who keep clusters; what goes wrong with a trial is told by its task.
        workers = LocalCluster(
            n_workers=local, threads_per_worker=1, dashboard_address=None, silence_logs=logging.ERROR
        )
        return Client(workers)
    try:
        return Client(cluster, timeout=CONNECT)
    except (OSError, TimeoutError, ValueError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ValueError(f"no Dask scheduler answers at {cluster}: {reason}") from None
