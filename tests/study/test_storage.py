"""Where trials are kept: what counts as finished and as lost, who may go on, and storages that are none."""

import dataclasses
import sqlite3
import threading
import time

import optuna
import pytest
import sqlalchemy
from optuna.exceptions import StorageInternalError
from optuna.storages import RDBStorage
from optuna.trial import TrialState

from jaxslam.study import storage as module
from jaxslam.study.storage import GRACE, connect, failure, load_study, open_study, redact_url, storage_url
from tests.study.studies import plan_of, store_of, url_of


@pytest.fixture
def plan(tmp_path):
    return plan_of(tmp_path)


def suggest(plan, store):
    """Number and settings of a new trial."""
    [trial] = store.ask(1)
    return trial, plan.space.suggest(trial, plan.configuration({}))


def test_what_counts_as_finished_and_what_as_lost(plan, tmp_path):
    store = store_of(plan, tmp_path)
    good, bad, interrupted, killed = store.ask(4)
    store.tell(good, [0.5])
    store.tell(bad, "the robot left the map")
    store.give_up([interrupted])
    states = [trial.state for trial in store.trials()]
    assert states == [TrialState.COMPLETE, TrialState.FAIL, TrialState.FAIL, TrialState.RUNNING]
    assert [trial.number for trial in store.finished()] == [good.number, bad.number]
    assert [failure(trial) for trial in store.trials()] == [None, "the robot left the map", None, None]
    # As those see it who go on.
    again = store_of(plan, tmp_path)
    assert [trial.number for trial in again.finished()] == [0, 1]
    assert again.trials()[killed.number].state == TrialState.RUNNING


def test_what_a_trial_was_worth_is_kept(plan, tmp_path):
    two = dataclasses.replace(plan, objectives=("error", "time"))
    store = store_of(two, tmp_path)
    trial, settings = suggest(two, store)
    store.tell(trial, [0.25, 3.0])
    [kept] = store_of(two, tmp_path).trials()
    assert kept.values == [0.25, 3.0]
    assert kept.params == settings
    assert set(settings) == {"sensor.sigma_hit", "motion.rotation_floor"}


def test_who_slept_and_was_given_up_tells_in_vain(plan, tmp_path):
    store = store_of(plan, tmp_path)
    first, second = store.ask(2)
    store_of(plan, tmp_path).give_up([first, second])
    store.tell(first, [0.5])
    store.tell(second, "too late as well")
    assert store.finished() == []
    assert [trial.state for trial in store.trials()] == [TrialState.FAIL] * 2


def age(tmp_path, seconds):
    """Every sign of life was so long ago."""
    with sqlite3.connect(tmp_path / "study.db") as database:
        database.execute(f"UPDATE trial_heartbeats SET heartbeat = datetime('now', '-{seconds} seconds')")
    database.close()


def wait_until(holds):
    for _ in range(1000):
        if holds():
            return
        time.sleep(0.01)
    raise AssertionError("it never came to be")


def state_of(store):
    [trial] = store.trials()
    return trial.state


def test_a_trial_of_which_nothing_is_heard_is_lost(plan, tmp_path):
    store = store_of(plan, tmp_path)
    with store.alive(store.ask(1)):
        pass
    other = store_of(plan, tmp_path)
    age(tmp_path, GRACE - 5)
    other.fail_stale_trials()
    assert state_of(other) == TrialState.RUNNING
    age(tmp_path, GRACE + 5)
    other.fail_stale_trials()
    assert state_of(other) == TrialState.FAIL
    assert other.finished() == []


def test_a_trial_that_was_killed_at_once_is_lost_too(plan, tmp_path, monkeypatch):
    """Optuna waits for ever for a trial that never gave a sign of life: the first comes with its start."""
    store = store_of(plan, tmp_path)
    monkeypatch.setattr(threading.Thread, "start", lambda self: None)
    monkeypatch.setattr(threading.Thread, "join", lambda self: None)
    with store.alive(store.ask(1)):
        age(tmp_path, GRACE + 5)
        store_of(plan, tmp_path).fail_stale_trials()
        assert state_of(store) == TrialState.FAIL


def test_a_trial_that_takes_long_gives_signs_of_life(plan, tmp_path, monkeypatch):
    store, other = store_of(plan, tmp_path), store_of(plan, tmp_path)
    monkeypatch.setattr(module, "HEARTBEAT", 0.02)
    trials = store.ask(1)
    study_id = store.storage.get_study_id_from_name(plan.name)

    def stale():
        return store.storage._get_stale_trial_ids(study_id)

    with store.alive(trials):
        for _ in range(2):
            age(tmp_path, GRACE + 5)
            wait_until(lambda: not stale())
        other.fail_stale_trials()
        assert state_of(other) == TrialState.RUNNING
    # And none when it has ended.
    age(tmp_path, GRACE + 5)
    time.sleep(0.1)
    assert len(stale()) == 1


def test_a_storage_that_is_away_for_a_moment_ends_no_signs_of_life(plan, tmp_path, monkeypatch):
    store = store_of(plan, tmp_path)
    beats, beat = [], RDBStorage.record_heartbeat

    def unsteady(self, trial_id):
        beats.append(trial_id)
        if 2 <= len(beats) < 4:
            raise StorageInternalError("away")
        beat(self, trial_id)

    monkeypatch.setattr(RDBStorage, "record_heartbeat", unsteady)
    monkeypatch.setattr(module, "HEARTBEAT", 0.01)
    with store.alive(store.ask(1)):
        wait_until(lambda: len(beats) >= 6)


@pytest.mark.parametrize("sampler", ["tpe", "random", "cma-es", "nsga-ii"])
def test_what_is_drawn_hangs_on_the_number_of_the_trial_only(plan, tmp_path, sampler):
    """Those who share a study, or go on with it, would otherwise try the same settings again."""
    plan = dataclasses.replace(plan, sampler=sampler)
    (tmp_path / "one").mkdir()
    (tmp_path / "more").mkdir()
    alone = store_of(plan, tmp_path / "one")
    drawn = []
    for _ in range(6):
        trial, settings = suggest(plan, alone)
        alone.tell(trial, [settings["sensor.sigma_hit"]])
        drawn.append(settings)
    assert len({settings["sensor.sigma_hit"] for settings in drawn}) == 6
    again = []
    for _ in range(3):
        # Two that were opened before either has drawn, and others in the next round.
        for store in (store_of(plan, tmp_path / "more"), store_of(plan, tmp_path / "more")):
            trial, settings = suggest(plan, store)
            store.tell(trial, [settings["sensor.sigma_hit"]])
            again.append(settings)
    assert again == drawn


def test_another_seed_of_the_sampler_draws_others(plan, tmp_path):
    drawn = []
    for seed in (0, 1):
        other = dataclasses.replace(plan, name=f"seed {seed}", sampler_seed=seed)
        drawn.append(suggest(other, store_of(other, tmp_path))[1])
    assert drawn[0] != drawn[1]


def test_a_study_goes_on_with_what_changes_no_value(plan, tmp_path):
    store = store_of(plan, tmp_path)
    store.tell(*store.ask(1), [0.5])
    more = dataclasses.replace(plan, trials=99, batch=3, sampler="random", held_out=plan.sources)
    assert len(store_of(more, tmp_path).finished()) == 1


@pytest.mark.parametrize(
    "change", [{"seeds": (5,)}, {"base": {"num_particles": 7}}, {"objectives": ("heading",)}]
)
def test_another_plan_of_that_name_is_refused(plan, tmp_path, change):
    store_of(plan, tmp_path)
    other = dataclasses.replace(plan, **change)
    with pytest.raises(
        ValueError, match=r"study\.db has a study 'try' with other logs, seeds, .* another name"
    ):
        store_of(other, tmp_path)
    # Under another name it is welcome.
    assert store_of(dataclasses.replace(other, name="other"), tmp_path).trials() == []


def test_a_study_of_somebody_else_is_left_alone(plan, tmp_path):
    theirs = optuna.create_study(study_name=plan.name, storage=connect(url_of(tmp_path)))
    theirs.optimize(lambda trial: trial.suggest_float("x", 0, 1), 1)
    with pytest.raises(ValueError, match="its study 'try' is not from jaxslam: give this one another"):
        store_of(plan, tmp_path)
    with pytest.raises(ValueError, match="the study 'try' is not from jaxslam"):
        load_study(url_of(tmp_path), None)
    assert theirs.user_attrs == {}


def test_tables_that_another_process_has_just_made(plan, tmp_path, monkeypatch):
    """Two that begin on one new file at once both find it without tables."""
    tries = []

    def late(url, **arguments):
        tries.append(url)
        if len(tries) == 1:
            raise sqlalchemy.exc.OperationalError("CREATE", {}, Exception("table studies already exists"))
        if len(tries) == 2:
            raise sqlalchemy.exc.IntegrityError("INSERT", {}, Exception("UNIQUE constraint failed"))
        return RDBStorage(url, **arguments)

    monkeypatch.setattr(module, "RDBStorage", late)
    store_of(plan, tmp_path)
    assert len(tries) == 3


def test_a_path_is_a_file_whatever_its_name(plan, tmp_path):
    path = tmp_path / "σ a?b#c%41.db"
    url = storage_url(str(path))
    open_study(plan, url)
    assert path.exists()
    assert redact_url(url) == str(path)
    assert load_study(url, None)[1] == plan.described()


def test_urls(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert storage_url("runs/a.db") == f"sqlite:///{tmp_path}/runs/a.db"
    assert storage_url("postgresql://me@host/x") == "postgresql://me@host/x"
    # No password goes to a terminal.
    assert redact_url("postgresql://me:secret@host/x") == "postgresql://me:***@host/x"
    assert redact_url("no url://") == "no url://"


@pytest.mark.parametrize(
    ("url", "message"),
    [
        ("sqlite:///{folder}", "unable to open database file"),
        ("sqlite:///{folder}/no/folder/study.db", "unable to open database file"),
        # Not even root may write there.
        ("sqlite:////proc/study.db", "unable to open database file"),
        ("sqlite:///{folder}/text.db", "file is not a database"),
        ("sqlite:///file:{folder}/good.db?mode=ro&uri=true", "attempt to write a readonly database"),
        ("nosql://host/study", "nosql"),
        ("oracle://host/study", "Failed to import DB access module|No module named"),
        ("://", "Could not parse"),
    ],
)
def test_a_storage_that_cannot_be_written_is_one_line(plan, tmp_path, url, message):
    (tmp_path / "text.db").write_text("no database at all, " * 100)
    open_study(plan, f"sqlite:///{tmp_path}/good.db")
    with pytest.raises(ValueError, match=f"this storage cannot be used: .*({message})") as caught:
        open_study(plan, url.format(folder=tmp_path))
    assert "\n" not in str(caught.value)


def test_a_complaint_without_words_has_its_name():
    match = r"x\.db: this storage cannot be used: StorageInternalError"
    with pytest.raises(ValueError, match=match), module.storage_errors("sqlite:///x.db"):
        raise StorageInternalError


def test_what_is_not_of_the_storage_is_not_blamed_on_it():
    with pytest.raises(RuntimeError, match="out of memory"), module.storage_errors("sqlite:///x.db"):
        raise RuntimeError("out of memory")


def test_a_report_on_a_study(plan, tmp_path):
    store = store_of(plan, tmp_path)
    store.tell(*store.ask(1), [0.5])
    for name in (None, "try"):
        found, described = load_study(url_of(tmp_path), name)
        assert described == plan.described()
        assert [trial.values for trial in found.finished()] == [[0.5]]
    store_of(dataclasses.replace(plan, name="other"), tmp_path)
    with pytest.raises(ValueError, match="several studies: give --name, one of try, other"):
        load_study(url_of(tmp_path), None)
    assert load_study(url_of(tmp_path), "other")[0].trials() == []
    with pytest.raises(ValueError, match="has no study 'tyr': there are"):
        load_study(url_of(tmp_path), "tyr")


def test_storages_that_have_no_study(tmp_path):
    path = tmp_path / "study.db"
    with pytest.raises(ValueError, match=r"study\.db does not exist: give the storage of a study"):
        load_study(url_of(tmp_path), None)
    assert not path.exists()
    path.write_bytes(b"")
    with pytest.raises(ValueError, match=r"study\.db: no study in it"):
        load_study(url_of(tmp_path), None)
    connect(url_of(tmp_path))
    with pytest.raises(ValueError, match=r"study\.db: no study in it"):
        load_study(url_of(tmp_path), None)
    path.write_text("no database at all, " * 100)
    with pytest.raises(ValueError, match=r"this storage cannot be used: .*file is not a database"):
        load_study(url_of(tmp_path), None)


def test_a_database_of_somebody_else_gets_no_tables(tmp_path):
    path = tmp_path / "study.db"
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE things (name TEXT)")
    database.close()
    before = path.read_bytes()
    with pytest.raises(ValueError, match="no study in it"):
        load_study(url_of(tmp_path), None)
    assert path.read_bytes() == before
