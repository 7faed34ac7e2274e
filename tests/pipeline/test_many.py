"""Many runs in one program are the runs that `run_log` makes, one by one."""

import dataclasses
from unittest.mock import Mock

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.figure import Figure

from jaxslam.config.dotted import update
from jaxslam.config.thinning import Thinning
from jaxslam.core.trajectory import Trajectory
from jaxslam.pipeline.inputs import PreparedScans, pair_scans
from jaxslam.pipeline.many import (
    _devices_in_memory,
    _program,
    bytes_per_device,
    run_many,
)
from jaxslam.pipeline.many_result import ManyResult
from jaxslam.pipeline.run import run_log
from jaxslam.proposal import MotionProposal
from jaxslam.slam import RBPF
from tests.pipeline.drives import drive, small_filter

KEYS = jnp.stack([jax.random.key(seed) for seed in range(3)])
SIGMAS = [0.1, 0.3]
THINNING = Thinning(0.1, 0.2)


@pytest.fixture(scope="module")
def prepared() -> PreparedScans:
    return pair_scans(drive(0, 6.0), THINNING)


@pytest.fixture(scope="module")
def slam(prepared) -> RBPF:
    """The traditional filter with little noise: it resamples, and compiles fast."""
    return small_filter(prepared, MotionProposal(), num_particles=4, threshold=0.9)


@pytest.fixture(scope="module")
def many(slam, prepared) -> ManyResult:
    return run_many(slam, prepared, KEYS, {"sensor.sigma_hit": SIGMAS}, maps=True)


def assert_same_runs(found, wanted, tolerance=1e-5):
    """The same runs but for rounding, which ends a beam in the next cell now and then.

    Where resampling hangs on that, the two part for good: it may be one run of six, and no more.
    """
    same = np.max(np.abs(found - wanted), axis=(-1, -2), initial=0.0) < tolerance
    assert np.mean(same) > 0.8, same


def test_every_run_is_that_of_run_log(slam, prepared, many):
    steps = len(prepared.stamps)
    assert many.trajectories.shape == (len(SIGMAS), len(KEYS), steps, 3)
    assert many.resampled.any()
    filters = [update(slam, {"sensor.sigma_hit": sigma}) for sigma in SIGMAS]
    alone = [[run_log(each, prepared, key) for key in KEYS] for each in filters]
    assert_same_runs(many.trajectories, np.array([[run.trajectory for run in row] for row in alone]))
    # Of the first run all is the same.
    first = alone[0][0]
    np.testing.assert_allclose(many.ess[0, 0], first.ess, rtol=1e-3)
    np.testing.assert_array_equal(many.resampled[0, 0], first.resampled)
    np.testing.assert_array_equal(many.flags[0, 0], first.flags)
    assert np.mean(many.log_odds[0, 0] != first.log_odds) < 2e-3
    assert len({run.tobytes() for run in many.trajectories.reshape(-1, steps, 3)}) == 6


def test_many_runs_show_themselves_as_a_table(many):
    shown = many._repr_html_()
    left = int(many.left_map.sum())
    for text in (
        f"{len(SIGMAS)} configurations × {len(KEYS)} keys",
        f"{many.trajectories.shape[2]} in the longest run",
        f"{many.scans_per_s:.0f} scans per second",
        f"{left} of {len(SIGMAS) * len(KEYS)} runs",
    ):
        assert text in shown


@pytest.fixture(scope="module")
def truth(prepared) -> Trajectory:
    """A path of another frame: the odometry, one meter to the side."""
    return Trajectory(prepared.all_stamps, prepared.all_odometry + np.array([0.0, 1.0, 0.0]))


def test_the_errors_are_those_of_run_log(slam, prepared, many, truth):
    errors = many.errors(truth)
    assert errors.shape == (2, 3)
    first = update(slam, {"sensor.sigma_hit": SIGMAS[0]})
    wanted = run_log(first, prepared, KEYS[0]).error(truth)
    assert errors[0, 0] == pytest.approx(wanted.rmse_m, rel=1e-4)
    assert (many.errors(truth, align=False) > 0.8).all()
    assert (errors < 0.3).all()
    np.testing.assert_array_equal(many.stamps, np.tile(prepared.stamps, (3, 1)))
    with pytest.raises(ValueError, match="0 truths for 3 keys: give one truth, or one for each key"):
        many.errors()
    with pytest.raises(ValueError, match="2 truths for 3 keys"):
        many.errors([truth, truth])


def test_the_table_shows_the_settings_and_the_errors(many, truth):
    assert many.configs == {"sensor.sigma_hit": SIGMAS}
    assert "configuration 1, sensor.sigma_hit = 0.3" in many._repr_html_()
    assert "RMSE" not in many._repr_html_()
    known = dataclasses.replace(many, truth=truth)
    row = known.errors()[1]
    left = int(many.left_map[1].sum())
    assert f"RMSE {row.mean():.3f} ± {row.std():.3f} m, {left} of 3 runs" in known._repr_html_()


def test_a_kept_map_is_drawn_with_its_path(many, truth):
    ax = many.plot(1, 2, Figure().subplots(), truth=truth)
    np.testing.assert_array_equal(ax.lines[0].get_xydata(), many.trajectories[1, 2, :, :2])
    assert {"estimated path", "true path"} <= set(ax.get_legend_handles_labels()[1])
    assert len(ax.images) == 1
    with pytest.raises(ValueError, match="no maps were kept: give maps=True"):
        dataclasses.replace(many, log_odds=None).plot()


def test_the_same_call_gives_the_same_bytes(slam, prepared, many):
    again = run_many(slam, prepared, KEYS, {"sensor.sigma_hit": SIGMAS}, maps=True)
    assert again.trajectories.tobytes() == many.trajectories.tobytes()
    assert again.log_odds.tobytes() == many.log_odds.tobytes()


def test_filters_may_be_given_in_place_of_names(slam, prepared, many):
    filters = [update(slam, {"sensor.sigma_hit": sigma}) for sigma in SIGMAS]
    again = run_many(slam, prepared, KEYS, filters)
    assert_same_runs(again.trajectories, many.trajectories)
    assert again.log_odds is None


def test_other_values_and_keys_compile_nothing(slam, prepared, many):
    program = _program(tuple(jax.devices()), 1, 64, False)
    run_many(slam, prepared, KEYS, {"sensor.sigma_hit": SIGMAS})
    before = program._cache_size()
    run_many(slam, prepared, KEYS[::-1], {"motion.translation_floor": [0.01, 0.02]})
    run_many(update(slam, {"usable_range": 2.5}), prepared, KEYS, {"sensor.sigma_hit": [0.2, 0.25]})
    assert program._cache_size() == before >= 1


@pytest.mark.parametrize(("together", "num_devices"), [(1, 1), (4, 1), (2, 2)])
def test_how_the_runs_are_laid_out_changes_nothing(slam, prepared, many, together, num_devices):
    """Six runs, of which a call takes 1, 4 or 4: the last call is not always full."""
    found = run_many(
        slam,
        prepared,
        KEYS,
        {"sensor.sigma_hit": SIGMAS},
        maps=True,
        together=together,
        devices=jax.devices()[:num_devices],
    )
    assert_same_runs(found.trajectories, many.trajectories, 1e-4)


def test_every_key_may_have_an_input_of_its_own(slam, prepared, many):
    inputs = [prepared, *(pair_scans(drive(seed, 3.0 + seed), THINNING) for seed in (1, 2))]
    assert len({len(each.stamps) for each in inputs}) == 3
    truths = [Trajectory(each.all_stamps, each.all_odometry) for each in inputs]
    found = run_many(slam, inputs, KEYS, truth=truths)
    assert found.configs == {}
    for column, (key, each) in enumerate(zip(KEYS, inputs, strict=True)):
        path = found.trajectories[0, column]
        length = len(each.stamps)
        # Before rounding can have set them apart.
        run = run_log(slam, each, key)
        alone = run.trajectory
        assert found.errors()[0, column] == pytest.approx(run.error(truths[column]).rmse_m, rel=0.2)
        np.testing.assert_array_equal(found.stamps[column, :length], each.stamps)
        np.testing.assert_allclose(path[: length // 3], alone[: length // 3], atol=1e-5)
        assert np.isfinite(path[:length]).all()
        assert np.isnan(path[length:]).all()
        assert not found.flags[0, column, length:].any()
    assert found.scans_per_s == pytest.approx(sum(len(each.stamps) for each in inputs) / found.run_s)


def test_a_robot_at_the_edge_of_its_map_is_told(slam, prepared, many):
    assert not many.left_map.any()
    origin = slam.grid.origin + jnp.asarray([5.0, 0.0], jnp.float32)
    moved = dataclasses.replace(slam, grid=dataclasses.replace(slam.grid, origin=origin))
    found = run_many(slam, prepared, KEYS[:1], [slam, moved])
    assert found.left_map.tolist() == [[False], [True]]


@pytest.mark.parametrize(
    ("configs", "message"),
    [
        ({"sensor.sigma_hti": [0.1]}, "did you mean 'sensor.sigma_hit'"),
        ({"sensor.sigma_hit": [0.1, -1.0]}, "sigma_hit is -1.0"),
        ({"sensor.sigma_hit": [0.1, float("nan")]}, "finite"),
        ({"sensor.sigma_hit": [0.1, 0.2], "usable_range": [3.0]}, "different numbers of values"),
        ({"num_particles": [4, 8]}, "num_particles is a size or a choice"),
        ({"proposal.kind": ["motion", "matched"]}, "proposal.kind is a size or a choice"),
        ({"sensor.sigma_hit": []}, "configs is empty"),
        ([], "configs is empty"),
    ],
)
def test_bad_configurations(slam, prepared, configs, message):
    with pytest.raises(ValueError, match=message) as caught:
        run_many(slam, prepared, KEYS, configs)
    assert "\n" not in str(caught.value)


def test_bad_inputs(slam, prepared, monkeypatch):
    with pytest.raises(ValueError, match="3 keys and 2 inputs"):
        run_many(slam, [prepared, prepared], KEYS)
    with pytest.raises(ValueError, match="0 keys"):
        run_many(slam, prepared, KEYS[:0])
    with pytest.raises(ValueError, match="already sharded over devices"):
        run_many(slam.shard(jax.devices()), prepared, KEYS)
    monkeypatch.setattr("jaxslam.pipeline.many.physical_memory", lambda: 1e5)
    with pytest.raises(
        ValueError, match=r"1 parallel runs of 4 maps .* GB, but only 0.0001 GB are available"
    ):
        run_many(slam, prepared, KEYS)
    with pytest.raises(ValueError, match=r"2 parallel runs of 4 maps"):
        run_many(slam, prepared, KEYS, devices=jax.devices()[:2])


def test_neither_devices_nor_runs_together_may_be_none(slam, prepared):
    with pytest.raises(ValueError, match="0 devices, None runs together: give one or more of each"):
        run_many(slam, prepared, KEYS, devices=[])
    for together in (0, -1):
        with pytest.raises(ValueError, match=f"2 devices, {together} runs together"):
            run_many(slam, prepared, KEYS, together=together)
    with pytest.raises(ValueError, match="no device to distribute the particles over"):
        slam.shard([])


@pytest.mark.parametrize(("room", "count"), [(1.0, 1), (1.9, 1), (2.1, 2), (4.5, 4), (99.0, 8)])
@pytest.mark.parametrize("kept_maps", [0, 10])
def test_as_many_devices_as_there_is_memory_for(slam, monkeypatch, room, count, kept_maps):
    kept = kept_maps * slam.grid.height * slam.grid.width
    memory = room * bytes_per_device(slam, 64, together=2) + kept
    monkeypatch.setattr("jaxslam.pipeline.many.physical_memory", lambda: memory)
    eight = tuple(jax.devices()[:1]) * 8
    assert len(_devices_in_memory(eight, slam, 64, 2, kept_maps, drop_some=True)) == count


def test_devices_with_memory_of_their_own_are_asked_for_it(slam):
    each = bytes_per_device(slam, 64, together=1)
    accelerator = Mock(spec=jax.devices()[0], platform="gpu")
    accelerator.memory_stats.return_value = {"bytes_limit": 1.1 * each}
    several = (accelerator,) * 4
    # Maps that are kept for the result are in main memory.
    assert _devices_in_memory(several, slam, 64, 1, 1000, drop_some=True) == several
    accelerator.memory_stats.return_value = {"bytes_limit": 1e5}
    with pytest.raises(
        ValueError, match=r"1 parallel runs of 4 maps .* 1000 kept maps .* only 0.0001 GB are available"
    ):
        _devices_in_memory(several, slam, 64, 1, 1000, drop_some=True)


@pytest.mark.parametrize("together", [1, 3])
def test_the_memory_is_what_the_compiler_says(slam, prepared, together, monkeypatch):
    """On maps that are what takes the memory."""
    grid = dataclasses.replace(slam.grid, height=1200, width=1000)
    large = dataclasses.replace(slam, grid=grid, num_particles=30, window_size=320)
    compiled, program = [], _program

    def only_compiled(*arguments):
        def call(*operands):
            compiled.append(program(*arguments).lower(*operands).compile().memory_analysis())
            raise RuntimeError("compiled")

        return call

    monkeypatch.setattr("jaxslam.pipeline.many._program", only_compiled)
    with pytest.raises(RuntimeError, match="compiled"):
        run_many(large, prepared, KEYS, together=together, devices=jax.devices()[:1])
    [found] = compiled
    needed = bytes_per_device(large, 64, together)
    assert 0.8 * needed < found.temp_size_in_bytes < 1.1 * needed


def test_particles_spread_over_devices_are_the_same_particles(slam, prepared):
    alone = run_log(slam, prepared, KEYS[0])
    spread = run_log(slam.shard(jax.devices()), prepared, KEYS[0])
    assert alone.resampled.any()
    np.testing.assert_allclose(spread.trajectory, alone.trajectory, atol=1e-5)
    np.testing.assert_array_equal(spread.infos.ancestors, alone.infos.ancestors)
    assert np.mean(spread.log_odds != alone.log_odds) < 1e-3


def test_a_filter_spread_over_devices_keeps_its_maps_there(slam, prepared):
    """What is sent between devices at a step is a map that is copied, and never all of them."""
    spread = slam.shard(jax.devices())
    state = jax.jit(RBPF.init)(spread, KEYS[0], jnp.asarray(prepared.pose0, jnp.float32))
    assert len(state.maps.sharding.device_set) == 2
    now = jax.tree.map(lambda leaf: leaf[0], prepared.inputs)
    program = jax.jit(RBPF.step).lower(spread, KEYS[0], state, now).compile().as_text()
    height, width = slam.grid.height, slam.grid.width
    gathers = [line for line in program.splitlines() if " all-gather(" in line]
    assert gathers
    assert not any(f"{height},{width}]" in line or "64,64]" in line for line in gathers)


def test_particles_that_cannot_be_shared_out(slam):
    with pytest.raises(ValueError, match="5 particles cannot be divided equally among 2 devices: give 6"):
        dataclasses.replace(slam, num_particles=5).shard(jax.devices())
    assert slam.shard(jax.devices()[:1]).mesh is None
