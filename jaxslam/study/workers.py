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
"""How often a task begins anew that could not reach the storage, or the like."""

MOST_WORKERS = 1024
"""Processes of one machine: more are an address without its scheme."""

_ANY_PORT = "127.0.0.1:0"
_ONE_AT_A_TIME = threading.Lock()
"""A process computes on all of its devices: threads of one worker take turns."""


def check_cluster(cluster: str, url: str) -> None:
    """Check a cluster as far as possible without connecting to it.

    Raises:
        ValueError: a number of workers that is none, or a SQLite file for those of other machines.
    """
    if (
        _local_workers(cluster) is None
        and url.startswith("sqlite")
        and _host(cluster) not in ("localhost", "127.0.0.1", "::1")
    ):
        raise ValueError(
            f"{redact_url(url)} is a file of this machine, which the workers of {cluster} cannot share: give "
            "--storage a database that they reach, such as postgresql://user@host/studies"
        )


def run_on_cluster(
    plan: Plan, url: str, cluster: str, programs: Path, on_trial: Callable[[Store, TrialResult], None]
) -> Store:
    """Run trials as `run_trials` does, on Dask workers.

    A worker that is killed loses its trial only: the scheduler gives the task to another one, which asks for
    a new trial.

    Args:
        plan: of the study.
        url: of the storage, which all workers must reach.
        cluster: address of a scheduler (`tcp://host:8786`), or `local:N` for N processes of this machine.
        programs: folder for compiled programs.
        on_trial: called here for every trial that ends.

    Raises:
        ValueError: the cluster cannot be reached, goes away, or does not go with this storage; the first
            trials all fail.
    """
    check_cluster(cluster, url)
    with _client(cluster, _local_workers(cluster)) as client, Interrupts() as interrupts:
        store = open_study(plan, url)
        # A trial that was given up in the meantime is made up for.
        while (left := plan.trials - len(store.finished())) > 0:
            for told in _spread(client, plan, url, left, programs, interrupts):
                on_trial(store, told)
                check_hope(store)
    return store


def _spread(
    client: Client, plan: Plan, url: str, left: int, programs: Path, interrupts: Interrupts
) -> Iterator[TrialResult]:
    """Run `left` trials in batches, and yield the results as they finish."""
    counts = [min(plan.batch, left - first) for first in range(0, left, plan.batch)]
    futures = [
        client.submit(_one_batch, plan, url, count, str(programs), pure=False, retries=RETRIES)
        for count in counts
    ]
    try:
        completed = as_completed(futures)
        while not completed.is_empty():
            with interrupts.passing():
                future = next(completed)
            yield from _result(future)
    finally:
        client.cancel(futures)


def _one_batch(plan: Plan, url: str, count: int, programs: str) -> list[TrialResult]:
    with _ONE_AT_A_TIME:
        keep_programs(Path(programs))
        store = open_study(plan, url)
        # Another session may go on with the same study.
        count = min(count, plan.trials - len(store.finished()))
        return run_batch(plan, store, count, Interrupts()) if count > 0 else []


def _result(future) -> list[TrialResult]:
    try:
        return future.result()
    except KilledWorker as error:
        raise ValueError(f"workers die of it: {error}") from None
    except CancelledError:
        # Nobody else cancels.
        raise ValueError(
            "the scheduler is gone: start the study again when there is one, what was told is kept"
        ) from None


class _OneOfSeveral(WorkerPlugin):
    """A worker of this machine, with its share of the cores.

    One that has more than its share spreads single operations over them: two workers that do so are no
    faster than one, with a core each they do twice as much.
    """

    def __init__(self, count: int):
        self.count = count

    def setup(self, worker: Worker) -> None:
        # Ctrl-C reaches it as well: it is the process which started it that stops it.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        # Dask numbers those that it starts; a name of another kind gets any share.
        index = worker.name if isinstance(worker.name, int) else zlib.crc32(str(worker.name).encode())
        keep_to(share_of_cores(index, self.count))


def share_of_cores(index: int, count: int) -> set[int]:
    """Return the cores of this process for worker `index` of `count`."""
    there = sorted(cores())
    if count >= len(there):
        return {there[index % len(there)]}
    return set(there[index % count :: count])


def keep_to(share: set[int]) -> None:
    """Keep every thread of this process, and those that they start, to some cores; on Linux alone."""
    for thread in Path("/proc/self/task").glob("*"):
        with suppress(ProcessLookupError):
            os.sched_setaffinity(int(thread.name), share)


def _host(cluster: str) -> str | None:
    return urlparse(cluster if "://" in cluster else f"tcp://{cluster}").hostname


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
        # Their logs are of those who keep clusters; what goes wrong with a trial is told by its task.
        # A port of its own choice: there may be other clusters, and without one Dask takes its usual port.
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
