"""Studies on Dask: workers of this machine, one that is killed, and clusters that are none."""

import dataclasses
import os
import signal
import sqlite3
from pathlib import Path

import dask
import pytest
from dask.distributed import Client, LocalCluster, WorkerPlugin

from jaxslam.study import workers as module
from jaxslam.study.search import run_trials
from jaxslam.study.storage import open_study
from jaxslam.study.workers import run_on_cluster, share_of_cores
from tests.study.studies import FILTER, LOGS, SPACE, STUDY, plan_of, url_of


def go(plan, folder, cluster, on_trial=lambda store, told: None):
    """What is told while the study goes on, and the study."""
    told = []

    def tell(store, each):
        told.append(each)
        on_trial(store, each)

    return told, run_on_cluster(plan, url_of(folder), cluster, folder / "programs", tell)


def made_up(folder, deadly=(), asleep=(), failing=False):
    """For workers: trials that cost nothing, of which some kill the process that is at them.

    Those asleep wake up when another process has given them up.

    A worker unpickles it without this module, which is not installed there: all it needs is inside.
    """
    marks = str(folder)

    class MadeUp(WorkerPlugin):
        def setup(self, worker):
            import numpy as np

            from jaxslam.study import search
            from jaxslam.study.measure import TrialError
            from jaxslam.study.objectives import Figures

            def measure(plan, source, seeds, settings):
                with open(Path(marks, "begun"), "a") as file:
                    file.write("x")
                    file.flush()
                    count = file.tell()
                if count in deadly:
                    os.kill(os.getpid(), signal.SIGKILL)
                if count in asleep:
                    with sqlite3.connect(Path(marks, "study.db")) as database:
                        database.execute("UPDATE trials SET state = 'FAIL' WHERE state = 'RUNNING'")
                    database.close()
                if failing:
                    return [TrialError("it cannot be") for _ in settings]
                error = [np.array([tried["sensor.sigma_hit"]]) for tried in settings]
                return [Figures(each, each, each, 1.0) for each in error]

            search.measure = measure

    return MadeUp()


@pytest.fixture
def cheap(monkeypatch, tmp_path):
    """Workers whose trials are made up."""
    real = module._client

    def use(**how):
        def client(cluster, local):
            made = real(cluster, local)
            made.register_plugin(made_up(tmp_path, **how))
            return made

        monkeypatch.setattr(module, "_client", client)

    return use


def test_workers_finish_a_study(tmp_path, cheap):
    cheap()
    plan = plan_of(tmp_path, trials=7, batch=2)
    told, store = go(plan, tmp_path, "local:2")
    assert sorted(each.number for each in told) == list(range(7))
    for each in told:
        assert each.values == (each.settings["sensor.sigma_hit"],)
        assert tuple(store.trials()[each.number].values) == each.values
    # No two workers drew the same.
    assert len({each.values for each in told}) == 7
    # Nothing is left to be done, and nothing is done.
    assert go(plan, tmp_path, "local:1")[0] == []


@pytest.mark.parametrize("cores", [1, 2, 5])
@pytest.mark.parametrize("count", [1, 2, 3, 8])
def test_workers_share_the_cores(monkeypatch, cores, count):
    there = set(range(10, 10 + cores))
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: there, raising=False)
    shares = [share_of_cores(index, count) for index in range(count)]
    # None idle, none without, and as equal as can be.
    assert set.union(*shares) == there
    assert all(share <= there for share in shares)
    assert max(map(len, shares)) - min(map(len, shares)) <= 1
    if count <= cores:
        assert sum(map(len, shares)) == cores
    # One that takes the place of a dead worker has any number.
    assert share_of_cores(1_000_003, count) in shares


def test_a_worker_keeps_to_its_share(tmp_path):
    if not hasattr(os, "sched_getaffinity"):
        pytest.skip("this system does not tell which cores a process may use")
    with module._client("local:2", 2) as client:
        # Where a task runs, and not in the thread that was told.
        found = [
            client.submit(os.sched_getaffinity, 0, workers=[name], pure=False).result() for name in (0, 1)
        ]
    assert sorted(map(sorted, found)) == sorted(sorted(share_of_cores(index, 2)) for index in range(2))


def test_a_worker_that_is_killed_loses_its_trial_only(tmp_path, cheap):
    cheap(deadly=(2,))
    plan = plan_of(tmp_path, trials=6)
    told, store = go(plan, tmp_path, "local:2")
    # What it had finished and not yet told is in the storage: its tasks are done again, for more trials.
    assert 6 <= len(store.finished()) <= 7
    assert len(told) >= 5
    assert all(trial.values is not None for trial in store.finished())
    # Of one that was begun nothing was heard any more.
    assert (tmp_path / "begun").stat().st_size == len(store.trials()) == len(store.finished()) + 1


def test_trials_that_kill_every_worker_end_the_study(tmp_path, cheap):
    cheap(deadly=range(1, 100))
    # Dask gives up after the fourth.
    at_once = dask.config.set({"distributed.scheduler.allowed-failures": 0})
    with at_once, pytest.raises(ValueError, match="killed several workers") as caught:
        go(plan_of(tmp_path, trials=2), tmp_path, "local:1")
    assert "\n" not in str(caught.value)


def test_where_all_trials_fail_the_study_is_given_up(tmp_path, cheap):
    cheap(failing=True)
    with pytest.raises(ValueError, match=r"the first [0-9]+ trials all failed, .* it cannot be"):
        go(plan_of(tmp_path, trials=20), tmp_path, "local:1")


def test_a_trial_that_was_given_up_meanwhile_is_made_up_for(tmp_path, cheap):
    """As one is that slept for longer than the grace: its task ends well, and nothing is known of it."""
    cheap(asleep=(2,))
    told, store = go(plan_of(tmp_path, trials=3), tmp_path, "local:1")
    assert len(told) == len(store.trials()) == 4
    assert [trial.number for trial in store.finished()] == [0, 2, 3]


def test_a_scheduler_elsewhere_on_this_machine_may_share_a_file(tmp_path, cheap):
    cheap()
    with Client(n_workers=1, threads_per_worker=2, dashboard_address="127.0.0.1:0") as there:
        address = there.scheduler.address
        told, _ = go(plan_of(tmp_path, trials=3), tmp_path, address)
        assert len(told) == 3
        # It is not ours to close.
        assert there.submit(lambda: 3).result() == 3


def test_a_scheduler_that_goes_away_ends_the_study_in_one_line(tmp_path, cheap):
    cheap()
    plan = plan_of(tmp_path, trials=50)
    with (
        LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address="127.0.0.1:0") as there,
        pytest.raises(ValueError, match="the scheduler is gone: start") as caught,
    ):
        go(plan, tmp_path, there.scheduler_address, lambda store, told: there.close())
    assert "\n" not in str(caught.value)
    # What was told stays.
    assert 1 <= len(open_study(plan, url_of(tmp_path)).finished()) < 50


def test_the_values_are_those_without_a_cluster(tmp_path):
    study = f'{STUDY}method = "rbpf"\nseeds = 1\ntrials = 2\nsampler = "random"\n'
    plan = plan_of(tmp_path, study, LOGS, SPACE, FILTER)
    _, store = go(plan, tmp_path, "local:1")
    alone = run_trials(dataclasses.replace(plan, name="alone"), url_of(tmp_path), lambda store, told: None)
    for here, there in zip(alone.trials(), store.trials(), strict=True):
        assert here.params == there.params
        assert here.values == pytest.approx(there.values, rel=1e-3)


@pytest.mark.parametrize(
    "cluster", ["local:x", "local:0", "local:-1", "local:", "local", "local:2.5", "local:²"]
)
def test_numbers_of_workers_that_are_none(tmp_path, cluster):
    with pytest.raises(ValueError, match=f"--cluster is '{cluster}': give local:N, with N processes"):
        go(plan_of(tmp_path), tmp_path, cluster)


@pytest.mark.parametrize("cluster", ["tcp://127.0.0.1:1", "localhost:1", "127.0.0.1:1", "foo://localhost:1"])
def test_a_cluster_that_cannot_be_reached_is_one_line(tmp_path, monkeypatch, cluster):
    monkeypatch.setattr(module, "CONNECT", 0.2)
    with pytest.raises(ValueError, match=f"no Dask scheduler answers at {cluster}: .") as caught:
        go(plan_of(tmp_path), tmp_path, cluster)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("cluster", ["tcp://10.1.2.3:8786", "far.example:8786", "far", ""])
def test_a_file_is_not_shared_with_other_machines(tmp_path, cluster):
    with pytest.raises(ValueError, match=r"study\.db is a file of this machine, .* postgresql://user@host"):
        go(plan_of(tmp_path), tmp_path, cluster)
    assert not (tmp_path / "study.db").exists()
