"""The trials of a study: how many, which fail, what runs together, and whose figures their values are."""

import dataclasses
from pathlib import Path

import jax
import numpy as np
import pytest
from jax.experimental.compilation_cache import compilation_cache
from optuna.trial import TrialState

from jaxslam.core.flags import Flag
from jaxslam.core.trajectory import Trajectory
from jaxslam.io import Relations, SensorLog
from jaxslam.io.log import OdometryTrack, ScanTrack
from jaxslam.pipeline.many_result import ManyResult
from jaxslam.pipeline.prepare import prepare
from jaxslam.pipeline.run import run_log
from jaxslam.study import measure as measuring
from jaxslam.study.interrupts import Interrupts
from jaxslam.study.measure import LoadedSource, TrialError, load, measure, program_of
from jaxslam.study.search import (
    HOPELESS,
    check_hope,
    evaluate,
    held_out_table,
    keep_programs,
    run_batch,
    run_trials,
    with_few_programs,
    with_lidars,
)
from jaxslam.study.storage import failure
from tests.study.studies import FILTER, LOGS, SPACE, STUDY, bowl, figures, plan_of, store_of, url_of


@pytest.fixture
def plan(tmp_path):
    return plan_of(tmp_path, trials=12)


@pytest.fixture
def cheap(monkeypatch):
    """Trials that cost nothing: their figures are made up by a function in place of `measure`."""

    def use(function):
        monkeypatch.setattr("jaxslam.study.search.measure", function)
        monkeypatch.setattr("jaxslam.study.search.load", lambda source: None)

    use(bowl)
    return use


def every(outcomes):
    """In place of `measure`: these outcomes, one after the other and again."""
    told = []

    def function(plan, source, seeds, settings):
        found = [outcomes[(len(told) + index) % len(outcomes)] for index in range(len(settings))]
        told.extend(found)
        return found

    return function


def go(plan, folder):
    """What is told while the study goes on, and the study."""
    told = []
    store = run_trials(plan, url_of(folder), lambda _, each: told.append(each))
    return told, store


def test_a_study_goes_on_to_so_many_trials_in_all(plan, tmp_path, cheap):
    told, store = go(dataclasses.replace(plan, trials=5), tmp_path)
    assert [each.number for each in told] == [0, 1, 2, 3, 4]
    kept = {trial.number: (trial.params, tuple(trial.values)) for trial in store.trials()}
    assert kept == {each.number: (each.settings, each.values) for each in told}
    assert go(dataclasses.replace(plan, trials=5), tmp_path)[0] == []
    told, store = go(plan, tmp_path)
    assert [each.number for each in told] == list(range(5, 12))
    assert len(store.finished()) == 12


def test_what_was_lost_is_made_up_for(plan, tmp_path, cheap):
    first = store_of(plan, tmp_path)
    first.give_up(first.ask(2))
    # This one is in flight, as far as anybody knows.
    first.ask(1)
    _, store = go(plan, tmp_path)
    assert len(store.finished()) == 12
    assert len(store.trials()) == 15


@pytest.mark.parametrize("sampler", ["tpe", "cma-es", "nsga-ii", "random"])
def test_every_sampler_runs_and_finds_something_better(tmp_path, cheap, sampler):
    plan = plan_of(tmp_path, trials=30, sampler=sampler)
    told, _ = go(plan, tmp_path)
    found = [each.values[0] for each in told]
    # The least of all values is 0.15, and the base has 0.93.
    assert min(found[15:]) < 0.4
    # Children of a genetic algorithm may be like their parents.
    assert len(set(found)) == 30 or sampler == "nsga-ii"


@pytest.mark.parametrize("sampler", ["tpe", "nsga-ii", "random"])
def test_samplers_of_several_objectives(tmp_path, cheap, sampler):
    plan = plan_of(tmp_path, trials=12, sampler=sampler, objectives=("error", "time", "map"), batch=5)
    told, store = go(plan, tmp_path)
    assert {len(each.values) for each in told} == {3}
    assert store.study.best_trials


def test_the_best_by_tpe_is_better_than_by_chance(tmp_path, cheap):
    found = {}
    for sampler in ("tpe", "random"):
        plan = plan_of(tmp_path, f'[study]\nname = "{sampler}"\n', trials=40, sampler=sampler)
        found[sampler] = np.mean([each.values[0] for each in go(plan, tmp_path)[0][20:]])
    assert found["tpe"] < 0.5 * found["random"]


def test_settings_of_some_methods_only(tmp_path, cheap):
    space = '[space]\nmethod = ["rbpf", "gmapping"]\n"proposal.lost_below" = { low = 0.1, high = 0.9 }'
    told, _ = go(plan_of(tmp_path, STUDY, LOGS, space, trials=12), tmp_path)
    methods = {each.settings["method"] for each in told}
    assert methods == {"rbpf", "gmapping"}
    for each in told:
        assert ("proposal.lost_below" in each.settings) == (each.settings["method"] == "gmapping")


def test_a_trial_that_fails_is_recorded_and_the_study_goes_on(plan, tmp_path, cheap):
    nan = figures(float("nan"))
    cheap(every([figures(0.1), TrialError("the robot left the map"), nan, figures(float("inf"))]))
    told, store = go(dataclasses.replace(plan, batch=2), tmp_path)
    assert len(store.finished()) == 12
    trials = store.trials()
    assert [trial.state for trial in trials] == [TrialState.COMPLETE, *[TrialState.FAIL] * 3] * 3
    assert trials[0].values == pytest.approx([0.15])
    assert failure(trials[1]) == told[1].values == "hall_small-0: the robot left the map"
    assert failure(trials[2]) == "error of [nan] are not finite"
    assert failure(trials[3]) == "error of [inf] are not finite"


def test_what_fails_on_one_source_is_not_run_on_the_next(plan, cheap):
    plan = dataclasses.replace(
        plan, sources=(plan.sources[0], dataclasses.replace(plan.sources[0], name="b"))
    )
    seen = []

    def function(plan, source, seeds, settings):
        seen.append((source.name, len(settings)))
        if source.name == "b":
            return [figures(0.4)] * len(settings)
        return [TrialError("lost"), figures(0.2), TrialError("lost")]

    cheap(function)
    outcomes = evaluate(plan, plan.sources, (0, 1), [{"num_particles": n} for n in (1, 2, 3)])
    assert seen == [("hall_small-0", 3), ("b", 1)]
    # Of several sources the mean counts: of 0.3 and 0.6.
    assert outcomes == ["hall_small-0: lost", [pytest.approx(0.45)], "hall_small-0: lost"]


def test_objectives_of_figures(plan, cheap):
    names = ("error", "worst-error", "heading", "map", "time")
    cheap(every([figures(0.2, map_loss=0.3, ms_per_scan=4.0)]))
    [outcome] = evaluate(dataclasses.replace(plan, objectives=names), plan.sources, (0, 1), [{}])
    assert outcome == pytest.approx([0.3, 0.4, 3.0, 0.3, 4.0])


def test_a_study_of_which_the_first_trials_all_fail_is_given_up(plan, tmp_path, cheap):
    cheap(every([TrialError("it cannot be")]))
    with pytest.raises(ValueError, match=f"the first {HOPELESS} trials all failed, .* it cannot be"):
        go(plan, tmp_path)
    assert len(store_of(plan, tmp_path).finished()) == HOPELESS


def test_one_success_gives_hope(plan, tmp_path, cheap):
    cheap(every([*[TrialError("lost")] * (HOPELESS - 1), figures(0.1)]))
    _, store = go(dataclasses.replace(plan, trials=2 * HOPELESS), tmp_path)
    assert len(store.finished()) == 2 * HOPELESS


def test_lost_trials_do_not_take_the_hope(plan, tmp_path):
    store = store_of(plan, tmp_path)
    store.give_up(store.ask(HOPELESS))
    check_hope(store)


@pytest.mark.parametrize("interruption", [KeyboardInterrupt, MemoryError])
def test_an_interrupted_trial_is_lost(plan, tmp_path, cheap, interruption):
    def function(plan, source, seeds, settings):
        raise interruption

    cheap(function)
    store = store_of(plan, tmp_path)
    with pytest.raises(interruption):
        run_batch(plan, store, 3, Interrupts())
    assert [trial.state for trial in store.trials()] == [TrialState.FAIL] * 3
    assert store.finished() == []


def test_the_held_out_table(plan, cheap):
    held_out = (dataclasses.replace(plan.sources[0], name="other", seed=7),)
    plan = dataclasses.replace(plan, held_out=held_out, seeds=(0, 1), held_out_seeds=(8, 9))
    calls = []

    def function(plan, source, seeds, settings):
        calls.append((source.name, seeds, settings))
        return [figures(0.2)] if settings == [{}] else [TrialError("lost")]

    cheap(function)
    tuned = {"sensor.sigma_hit": 0.07}
    assert [name for name, _, _ in held_out_table(plan, tuned)] == [
        "tuned on, its seeds",
        "tuned on, other seeds",
        "held out: other",
    ]
    # Each alone, before and after: in a batch the times would be those of all.
    wanted = [("hall_small-0", (0, 1)), ("hall_small-0", (8, 9)), ("other", (8, 9))]
    assert calls == [(name, seeds, [tried]) for name, seeds in wanted for tried in ({}, tuned)]
    _, before, after = held_out_table(plan, tuned)[-1]
    assert before == [pytest.approx(0.3)]
    assert after == "other: lost"


# Measuring, with runs that cost nothing.


def made_up() -> LoadedSource:
    """A robot that drives 4 m straight on, between nothing; its odometry is the truth."""
    stamps = np.arange(41) / 10
    poses = np.stack([stamps, 0 * stamps, 0 * stamps], axis=1)
    count, beams = len(stamps), 8
    scans = ScanTrack(
        stamps=stamps,
        ranges=np.full((count, beams), 3.0, np.float32),
        num_beams=np.full(count, beams),
        angle_min=np.full(count, -1.0),
        angle_increment=np.full(count, 0.25),
        range_min=0.1,
        range_max=10.0,
        pose_base_lidar=np.zeros(3),
        mounting_known=True,
        topic="scan",
    )
    odometry = OdometryTrack(stamps, poses, np.full((count, 3), np.nan), "odometry")
    return LoadedSource(SensorLog(Path("made up"), odometry, scans=scans), "sick", Trajectory(stamps, poses))


@pytest.fixture
def runs(monkeypatch):
    """Calls of `run_many`: how many filters each, and what is in the results besides the odometry."""
    calls, wrong = [], {"flags": 0, "trajectory": 0.0, "error": None}

    def run_many(slam, prepared, keys, filters, *, maps):
        calls.append(len(filters))
        if wrong["error"] is not None:
            raise wrong["error"]
        shape = (len(filters), len(keys), len(prepared.stamps))
        poses = np.zeros((*shape, 3), np.float32)
        poses[..., 0] = prepared.stamps + wrong["trajectory"]
        flags = np.zeros(shape, np.int32)
        flags[0, 0, -1] = wrong["flags"]
        blank = np.zeros(shape, np.float32)
        grids = tuple(each.grid for each in filters)
        times = (0.0, 1.0, 1.0, 5.0 * len(calls))
        return ManyResult((prepared,), {}, grids, poses, blank, blank > 0, flags, None, *times)

    monkeypatch.setattr(measuring, "run_many", run_many)
    monkeypatch.setattr(measuring, "load", lambda source: made_up())
    return calls, wrong


def test_a_batch_runs_together_what_is_of_one_program(plan, runs):
    calls, _ = runs
    batch = [
        {"num_particles": 3, "sensor.sigma_hit": 0.1},
        {"num_particles": 5, "sensor.sigma_hit": 0.1},
        {"num_particles": 3, "sensor.sigma_hit": 0.2},
        {"num_particles": 5, "method": "rbpf"},
        {"num_particles": 3, "motion.rotation_floor": 0.01},
        {"num_particles": 5, "sensor.sigma_hit": 0.3},
    ]
    found = measure(plan, plan.sources[0], (0, 1), batch)
    assert calls == [3, 2, 1]
    # Each has its own figures: those of its program's call.
    assert [each.ms_per_scan for each in found] == [5.0, 10.0, 5.0, 15.0, 5.0, 10.0]
    assert all(each.error.shape == (2,) for each in found)
    np.testing.assert_allclose([each.error for each in found], 0.0, atol=1e-5)


def test_what_the_inputs_depend_on_is_not_run_together(plan, runs):
    calls, _ = runs
    batch = [{}, {"thinning.min_translation": 0.5}, {"lidar.usable_range": 12.0}, {"fusion.use": "auto"}]
    measure(plan, plan.sources[0], (0,), batch)
    assert calls == [1, 1, 1, 1]


def test_where_time_counts_each_runs_alone(plan, runs):
    calls, _ = runs
    measure(dataclasses.replace(plan, objectives=("error", "time")), plan.sources[0], (0,), [{}, {}, {}])
    assert calls == [1, 1, 1]


def test_a_configuration_that_is_none_spoils_no_other(plan, runs):
    calls, _ = runs
    batch = [{"sensor.sigma_hit": 0.1}, {"sensor.sigma_hit": -0.1}, {"num_particles": 10**9}, {}]
    found = measure(plan, plan.sources[0], (0,), batch)
    assert calls == [2]
    assert "sigma_hit is -0.1" in str(found[1])
    assert "1000000000 maps" in str(found[2])
    assert [isinstance(each, TrialError) for each in found] == [False, True, True, False]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"flags": Flag.OFF_MAP.value}, "the robot left the map in 1 of 2 runs"),
        ({"trajectory": np.nan}, "a trajectory is not finite"),
        ({"error": ValueError("more memory than there is")}, "more memory than there is"),
        ({"error": jax.errors.JaxRuntimeError("RESOURCE_EXHAUSTED")}, "RESOURCE_EXHAUSTED"),
    ],
)
def test_runs_that_cannot_be_measured(plan, runs, wrong, message):
    runs[1].update(wrong)
    [first, *_] = measure(plan, plan.sources[0], (0, 1), [{}, {"sensor.sigma_hit": 0.2}])
    assert isinstance(first, TrialError)
    assert message in str(first)


def test_one_that_left_its_map_spoils_no_other(plan, runs):
    runs[1]["flags"] = Flag.OFF_MAP.value
    first, second = measure(plan, plan.sources[0], (0, 1), [{}, {"sensor.sigma_hit": 0.2}])
    assert isinstance(first, TrialError)
    assert second.error.shape == (2,)


def unusable() -> dict[str, LoadedSource]:
    """Sources that cannot be measured, by what is said of them."""
    loaded = made_up()
    stamps, poses = loaded.reference
    nothing = Relations(stamps[:0], stamps[:0], poses[:0])
    return {
        "no odometry in it": dataclasses.replace(loaded, log=dataclasses.replace(loaded.log, odometry=None)),
        "0 of the 41 reference poses": dataclasses.replace(
            loaded, reference=Trajectory(stamps + 1000.0, poses)
        ),
        "none of the 0 relations": dataclasses.replace(loaded, relations=nothing),
    }


@pytest.mark.parametrize(("message", "source"), unusable().items())
def test_a_source_that_cannot_be_measured_fails_the_trial_only(plan, runs, monkeypatch, message, source):
    monkeypatch.setattr(measuring, "load", lambda _: source)
    [found] = measure(plan, plan.sources[0], (0, 1), [{}])
    assert message in str(found)


def test_sizes_are_given_steps_where_the_program_depends_on_them(tmp_path, runs):
    space = """[space]
"sensor.sigma_hit" = { low = 0.02, high = 0.3, log = true }
num_particles = { low = 4, high = 40 }
map.margin = { low = 4.0, high = 12.0 }
"thinning.min_translation" = { low = 0.21, high = 0.22 }
"""
    plan = plan_of(tmp_path, STUDY, LOGS, space)
    stepped = {p.name: p.step for p in with_few_programs(plan).space.parameters}
    assert stepped == {
        "sensor.sigma_hit": None,
        "num_particles": 9,
        "map.margin": 2.0,
        "thinning.min_translation": None,
    }
    programs = [program_of(plan, plan.sources[0], {"num_particles": n}) for n in (4, 4, 40)]
    assert programs[0] == programs[1] != programs[2]


def test_the_lidar_that_the_scans_tell_is_a_part_of_the_plan(plan, runs, monkeypatch):
    monkeypatch.setattr("jaxslam.study.search.load", lambda source: made_up())
    assert [source.lidar for source in with_lidars(plan).sources] == ["sick"]


@pytest.mark.parametrize(("message", "source"), unusable().items())
def test_logs_are_looked_at_before_anything_runs(plan, runs, monkeypatch, message, source):
    """Those held out as well, which would else be looked at after hours."""
    plan = dataclasses.replace(plan, held_out=(dataclasses.replace(plan.sources[0], name="other"),))
    found = {"hall_small-0": made_up(), "other": source}
    monkeypatch.setattr(measuring, "load", lambda source: found[source.name])
    monkeypatch.setattr("jaxslam.study.search.load", lambda source: found[source.name])
    with pytest.raises(ValueError, match=f"^other: .*{message}") as caught:
        with_lidars(plan)
    assert "\n" not in str(caught.value)
    assert runs[0] == []
    # Nothing to be measured by is nothing wrong, where only the time counts.
    found["other"] = dataclasses.replace(made_up(), reference=None)
    with_lidars(plan)


# Measuring for real.


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drive")
    names = ("jax_compilation_cache_dir", "jax_persistent_cache_min_compile_time_secs")
    before = {name: getattr(jax.config, name) for name in names}
    keep_programs(folder / "programs")
    yield folder
    for name, value in before.items():
        jax.config.update(name, value)
    compilation_cache.reset_cache()


def test_the_values_of_a_trial_are_those_of_its_runs(drive):
    study = f'{STUDY}method = "rbpf"\nseeds = 2\ntrials = 2\nbatch = 2\nobjectives = ["error", "map"]\n'
    plan = with_lidars(plan_of(drive, study, LOGS, SPACE, FILTER))
    told, store = go(plan, drive)
    assert [len(each.values) for each in told] == [2, 2]
    assert [trial.values for trial in store.trials()] == [list(each.values) for each in told]
    assert any((drive / "programs").iterdir())
    loaded = load(plan.sources[0])
    for each in told:
        slam, scans = prepare(loaded.log, plan.configuration(each.settings, loaded.lidar))
        errors = []
        for seed in plan.seeds:
            errors.append(run_log(slam, scans, jax.random.key(seed)).error(loaded.reference).rmse_m)
        assert each.values[0] == pytest.approx(np.mean(errors), rel=1e-3)
        # Two runs that differ, and walls that are partly where they belong.
        assert errors[0] != errors[1]
        assert 0.05 < each.values[1] < 0.95
