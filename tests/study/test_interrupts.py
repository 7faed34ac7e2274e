"""Ctrl-C during a study: it waits for the storage, and is never lost."""

import contextlib
import os
import signal
import threading

import pytest
from optuna.trial import TrialState

from jaxslam.study.interrupts import Interrupts
from jaxslam.study.search import run_trials
from jaxslam.study.storage import Store
from tests.study.studies import bowl, plan_of, store_of, url_of


@pytest.fixture(autouse=True)
def as_in_a_terminal():
    """A shell starts what runs in the background deaf to Ctrl-C, these tests perhaps among it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def ctrl_c():
    os.kill(os.getpid(), signal.SIGINT)


def session(before=False, within=False, lost=False):
    """What is done of a session before, in and after what takes long, if Ctrl-C comes there."""
    done = []
    try:
        with Interrupts() as interrupts:
            if before:
                ctrl_c()
                ctrl_c()
            done.append("before")
            with interrupts.passing():
                if lost:
                    # As in a callback of the garbage collector: it is printed, and goes no further.
                    with contextlib.suppress(KeyboardInterrupt):
                        ctrl_c()
                if within:
                    ctrl_c()
                done.append("within")
            done.append("after")
    except KeyboardInterrupt:
        done.append("interrupted")
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    return done


def test_where_an_interrupt_ends_a_session():
    assert session() == ["before", "within", "after"]
    # It waits for the storage, and goes before what takes long.
    assert session(before=True) == ["before", "interrupted"]
    assert session(within=True) == ["before", "interrupted"]
    assert session(lost=True) == ["before", "within", "interrupted"]


def test_an_interrupt_waits_for_the_end_where_nothing_takes_long():
    done = []

    def work():
        with Interrupts():
            ctrl_c()
            done.append("all of it")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert done == ["all of it"]


def test_an_error_is_not_hidden_by_an_interrupt():
    def work():
        with Interrupts():
            ctrl_c()
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        work()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_where_interrupts_are_ignored_they_stay_so():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with Interrupts() as interrupts, interrupts.passing():
            ctrl_c()
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_thread_has_none():
    done = []

    def work():
        with Interrupts() as interrupts, interrupts.passing():
            done.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert done == [signal.default_int_handler]


@pytest.mark.parametrize("method", ["ask", "tell", "finished", "fail_stale_trials"])
def test_a_study_is_interrupted_between_two_transactions(tmp_path, monkeypatch, method):
    """In the middle of one its lock would stay, and the next write wait a minute for it."""
    monkeypatch.setattr("jaxslam.study.search.measure", bowl)
    monkeypatch.setattr("jaxslam.study.search.load", lambda source: None)
    plan, real, calls = plan_of(tmp_path), getattr(Store, method), []

    def interrupted(self, *arguments):
        if len(calls) == 3:
            ctrl_c()
        found = real(self, *arguments)
        calls.append(method)
        return found

    monkeypatch.setattr(Store, method, interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_trials(plan, url_of(tmp_path), lambda store, told: None)
    # Before the next batch it may look once more how many there are.
    assert len(calls) <= 5
    monkeypatch.undo()
    states = [trial.state for trial in store_of(plan, tmp_path).trials()]
    # The trial that had not begun to run is lost, one that had ended is kept.
    assert states[:-1] == [TrialState.COMPLETE] * (len(states) - 1)
    assert states[-1] == TrialState.FAIL
