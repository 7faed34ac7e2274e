"""A study on a Dask cluster: workers pull trials from the same storage."""

import logging
import os
import signal
import threading
import zlib
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from contextlib import suppress
from pathlib import Path
from urllib.parse import urlparse

from dask.distributed import Client, KilledWorker, Worker, WorkerPlugin, as_completed

from jaxslam.study.interrupts import Interrupts
from jaxslam.study.plan import Plan
from jaxslam.study.search import TrialResult, check_hope, keep_programs, run_batch
from jaxslam.study.storage import Store, open_study, redact_url
from jaxslam.xla.sharding import cores

CONNECT = 10
"""Seconds to wait for a scheduler."""
RETRIES = 2
"""Retries of a task after an error, such as an unreachable storage."""
MOST_WORKERS = 1024
"""Most processes of one machine; a larger number is probably the port of an address without its scheme."""

_ANY_PORT = "127.0.0.1:0"
_ONE_AT_A_TIME = threading.Lock()
"""A process computes on all of its devices, so the threads of one worker take turns."""


def check_cluster(cluster: str, url: str) -> None:
    """Check a cluster as far as possible without connecting to it.

    Raises:
        ValueError: the number of workers is invalid, or workers on other machines would need a SQLite file.
    """
    host = urlparse(cluster if "://" in cluster else f"tcp://{cluster}").hostname
    is_elsewhere = _local_workers(cluster) is None and host not in ("localhost", "127.0.0.1", "::1")
    if is_elsewhere and url.startswith("sqlite"):
        raise ValueError(
            f"{redact_url(url)} is a file of this machine, which the workers of {cluster} cannot share: give "
            "--storage a database on the network, such as postgresql://user@host/studies"
        )


def run_on_cluster(
    plan: Plan, url: str, cluster: str, programs: Path, on_trial: Callable[[Store, TrialResult], None]
) -> Store:
    """Run trials as `run_trials` does, on Dask workers.

    A killed worker loses only its current trial: the scheduler gives the task to another worker, which asks
    for a new trial.

    Args:
        plan: plan of the study.
        url: URL of the storage, which all workers must reach.
        cluster: address of a scheduler (`tcp://host:8786`), or `local:N` for N processes of this machine.
        programs: folder for compiled programs.
        on_trial: called in this process for every finished trial.

    Raises:
        ValueError: the cluster cannot be reached, disappears, or cannot use this storage; the first trials
            all fail.
    """
    check_cluster(cluster, url)
    with _client(cluster, _local_workers(cluster)) as client, Interrupts() as interrupts:
        store = open_study(plan, url)
        # The loop replaces trials that were lost in the meantime.
        while (left := plan.trials - len(store.finished())) > 0:
            for result in _spread(client, plan, url, left, programs, interrupts):
                on_trial(store, result)
                check_hope(store)
    return store


def _spread(
    client: Client, plan: Plan, url: str, left: int, programs: Path, interrupts: Interrupts
) -> Iterator[TrialResult]:
    """Run `left` trials in batches, and yield the results as they finish."""
    futures = [
        client.submit(
            _one_batch, plan, url, min(plan.batch, left - first), programs, pure=False, retries=RETRIES
        )
        for first in range(0, left, plan.batch)
    ]
    try:
        completed = as_completed(futures)
        while not completed.is_empty():
            with interrupts.passing():
                future = next(completed)
            yield from _result(future)
    finally:
        client.cancel(futures)


def _one_batch(plan: Plan, url: str, count: int, programs: Path) -> list[TrialResult]:
    with _ONE_AT_A_TIME:
        keep_programs(programs)
        store = open_study(plan, url)
        # Another session may continue the same study.
        count = min(count, plan.trials - len(store.finished()))
        return run_batch(plan, store, count, Interrupts()) if count > 0 else []


def _result(future) -> list[TrialResult]:
    try:
        return future.result()
    except KilledWorker as error:
        raise ValueError(f"a batch of trials killed several workers: {error}") from None
    except CancelledError:
        # Only a lost scheduler cancels tasks.
        raise ValueError(
            "the scheduler is gone: start the study again with a new scheduler; finished trials are kept"
        ) from None


class _OneOfSeveral(WorkerPlugin):
    """Restrict a worker of this machine to its share of the cores.

    An unrestricted worker spreads single operations over all cores. Two such workers are no faster than one;
    with one core each, they finish twice as many trials.
    """

    def __init__(self, count: int):
        self.count = count

    def setup(self, worker: Worker) -> None:
        # Ctrl-C reaches the worker as well, but the process that started the worker must stop it.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        # Dask numbers the workers that it starts; any other name is hashed to a share.
        index = worker.name if isinstance(worker.name, int) else zlib.crc32(str(worker.name).encode())
        keep_to(share_of_cores(index, self.count))


def share_of_cores(index: int, count: int) -> set[int]:
    """Return the cores of this process for worker `index` of `count`."""
    there = sorted(cores())
    if count >= len(there):
        return {there[index % len(there)]}
    return set(there[index % count :: count])


def keep_to(share: set[int]) -> None:
    """Restrict every thread of this process, and threads started later, to some cores (Linux only)."""
    for thread in Path("/proc/self/task").glob("*"):
        with suppress(ProcessLookupError):
            os.sched_setaffinity(int(thread.name), share)


def _local_workers(cluster: str) -> int | None:
    kind, _, count = cluster.partition(":")
    if kind != "local":
        return None
    if not (count.isdecimal() and 1 <= int(count) <= MOST_WORKERS):
        raise ValueError(
            f"--cluster is {cluster!r}: give local:N, with N processes of 1 to {MOST_WORKERS}, or a "
            "scheduler's address"
        )
    return int(count)


def _client(cluster: str, local: int | None) -> Client:
    if local is not None:
        # Errors of a trial arrive through its task, so the workers' logs are not needed.
        # The dashboard takes any free port, because another cluster may use Dask's usual one.
        client = Client(
            n_workers=local, threads_per_worker=1, dashboard_address=_ANY_PORT, silence_logs=logging.ERROR
        )
        client.register_plugin(_OneOfSeveral(local))
        return client
    try:
        return Client(cluster, timeout=CONNECT)
    except (OSError, TimeoutError, ValueError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ValueError(f"no Dask scheduler answers at {cluster}: {reason}") from None
