"""The whole filter: tracking, a global start, a kidnapping, degenerate input."""

import dataclasses

import chex
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.config.dotted import update
from jaxslam.config.localization import LocalizationConfig
from jaxslam.localization import AMCL, Averages, KLDSampling, Recovery
from jaxslam.localization.start import start_at
from jaxslam.motion import OmnidirectionalMotion
from jaxslam.pipeline.build import build_localizer
from jaxslam.pipeline.chunks import run_steps
from jaxslam.pipeline.inputs import pair_scans
from jaxslam.pipeline.localize import find_jumps, localize_log
from jaxslam.resampling import normalize
from jaxslam.sim import sick, simulate, to_log
from tests.builders import hall_map
from tests.checks import assert_strongly_typed, jit_once

SMALL = {"max_particles": 8192, "min_particles": 200}
KEY = jax.random.key(5)
_CELL = np.argwhere(hall_map()[0].occupied)[100]
WALL = (*(-0.5 + 0.05 * (_CELL[::-1] + 0.5)), 0.0)


@pytest.fixture(scope="module")
def drive():
    """A minute in the small hall: the map, the log ready for the filter, the true poses at its scans."""
    occupancy, world, waypoints = hall_map()
    simulation = simulate(KEY, world, waypoints, lidar=sick(num_beams=61), duration=60.0)
    log = to_log(simulation, in_world_frame=True)
    prepared = pair_scans(log, LocalizationConfig().thinning)
    return occupancy, prepared, np.asarray(simulation.scan_poses, float)[prepared.scan_index]


@pytest.fixture(scope="module")
def amcl(drive):
    return build_localizer(update(LocalizationConfig(), SMALL), drive[0])


def errors(result, truth):
    return np.hypot(*(result.estimates[:, :2] - truth[:, :2]).T)


def test_tracking(drive, amcl):
    _, prepared, truth = drive
    result = localize_log(amcl, prepared, KEY, tuple(truth[0]), deviations=(0.3, 0.1))
    after = errors(result, truth)[10:]
    assert np.sqrt(np.mean(after**2)) < 0.06
    assert after.max() < 0.2
    assert result.converged
    assert result.kidnapped_events == 0
    assert result.agreed.mean() > 0.9
    assert np.median(result.infos.num_particles) == 200
    assert result.warnings == ()


def test_global_start(drive, amcl):
    _, prepared, truth = drive
    result = localize_log(amcl, prepared, KEY)
    assert result.infos.num_particles[0] == 8192
    assert result.infos.num_particles[-1] < 1000
    assert result.converged
    assert errors(result, truth)[-5:].max() < 0.2
    assert 0.0 < result.converged_after_s < 40.0


def test_a_kidnapped_robot_is_found_again(drive, amcl):
    _, prepared, truth = drive
    # Set down where the drive was half a minute later, as far as the odometry knows without moving.
    half = len(truth) // 2
    kept = np.r_[0:20, half : len(truth)]
    inputs = jax.tree.map(lambda leaf: leaf[kept], prepared.inputs)
    inputs = eqx.tree_at(
        lambda i: i.odometry.delta, inputs, inputs.odometry.delta.at[20].set(jnp.zeros(3, jnp.float32))
    )
    assert np.hypot(*(truth[half] - truth[19])[:2]) > 3.0
    state = start_at(amcl, KEY, tuple(truth[0]), (0.3, 0.1))
    _, infos = jax.jit(run_steps)(amcl, inputs, KEY, state)
    found = np.hypot(*(np.asarray(infos.estimate.mean) - truth[kept])[:, :2].T)
    assert found[10:20].max() < 0.2
    assert found[20] > 2.0
    assert found[-5:].max() < 0.3
    assert int(np.asarray(infos.num_random)[20:].sum()) > 0
    assert int(np.asarray(infos.num_random)[:20].sum()) == 0


def test_host_loop_and_scan_give_the_same(drive, amcl):
    _, prepared, truth = drive
    # `localize_log` draws the start with this key.
    key_start = jax.random.fold_in(KEY, 2**32 - 1)
    state = start_at(amcl, key_start, tuple(truth[0]), (0.3, 0.1))
    expected = jax.jit(run_steps)(amcl, prepared.inputs, KEY, state)[1].estimate.mean
    result = localize_log(amcl, prepared, KEY, tuple(truth[0]), deviations=(0.3, 0.1))
    np.testing.assert_allclose(result.estimates, expected, atol=1e-4)


def test_same_key_same_bytes(drive, amcl):
    _, prepared, truth = drive
    runs = [
        localize_log(amcl, prepared, jax.random.key(seed), tuple(truth[0]), deviations=(0.3, 0.1))
        for seed in (1, 1, 2)
    ]
    assert runs[0].estimates.tobytes() == runs[1].estimates.tobytes()
    assert runs[0].estimates.tobytes() != runs[2].estimates.tobytes()


def test_omnidirectional_motion_tracks_too(drive, amcl):
    _, prepared, truth = drive
    omni = dataclasses.replace(amcl, motion=OmnidirectionalMotion())
    result = localize_log(omni, prepared, KEY, tuple(truth[0]), deviations=(0.3, 0.1))
    assert errors(result, truth)[10:].max() < 0.3


def steps(amcl, state, inputs, count=3):
    step = jax.jit(AMCL.step)
    for number in range(count):
        state, info = step(amcl, jax.random.key(number), state, inputs)
    return state, info


def at(prepared, index):
    return jax.tree.map(lambda leaf: leaf[index], prepared.inputs)


def test_a_blind_scan_moves_by_odometry_alone(drive, amcl):
    _, prepared, truth = drive
    blind = eqx.tree_at(lambda i: i.scan.valid, at(prepared, 3), jnp.zeros(61, bool))
    _, info = steps(amcl, start_at(amcl, KEY, tuple(truth[0]), (0.1, 0.05)), blind)
    assert int(info.flags) != 0
    assert not bool(info.resampled)
    assert np.isnan(float(info.match_score))
    moved = 3 * np.linalg.norm(np.asarray(blind.odometry.delta)[:2])
    far = np.hypot(*(np.asarray(info.estimate.mean)[:2] - truth[0, :2]))
    assert far == pytest.approx(moved, abs=0.1)


def test_broken_odometry_moves_nothing(drive, amcl):
    _, prepared, truth = drive
    broken = eqx.tree_at(lambda i: i.odometry.delta, at(prepared, 0), jnp.full(3, jnp.nan))
    state, info = steps(amcl, start_at(amcl, KEY, tuple(truth[0]), (0.1, 0.05)), broken)
    live = np.asarray(state.poses)[: int(state.num_particles)]
    assert np.isfinite(live).all()
    assert int(info.flags) != 0
    assert np.hypot(*(np.asarray(info.estimate.mean)[:2] - truth[0, :2])) < 0.15


def test_weights_that_are_all_zero_do_not_end_it(drive, amcl):
    _, prepared, truth = drive

    class Nothing(type(amcl.sensor)):
        def log_likelihoods(self, *arguments):
            return jnp.full(arguments[3].shape[0], -jnp.inf)

    nothing = dataclasses.replace(amcl, sensor=Nothing())
    state, info = steps(nothing, start_at(amcl, KEY, tuple(truth[0]), (0.1, 0.05)), at(prepared, 3))
    assert np.isfinite(np.asarray(info.estimate.mean)).all()
    assert 1 <= int(state.num_particles) <= 8192
    assert float(jnp.sum(jnp.exp(state.log_weights))) == pytest.approx(1.0, abs=1e-3)


def test_a_particle_whose_likelihood_is_no_number_dies(drive, amcl):
    _, prepared, truth = drive

    class Broken(type(amcl.sensor)):
        def log_prob_all(self, prepared, scan, poses):
            return jnp.where(jnp.arange(poses.shape[0]) == 7, jnp.nan, -5.0)

    broken = dataclasses.replace(amcl, sensor=Broken(), resample_below=0.0)
    start = start_at(amcl, KEY, tuple(truth[0]), (0.1, 0.05))
    state, _ = steps(broken, start, at(prepared, 3), count=1)
    weights = np.exp(np.asarray(state.log_weights))
    assert weights[7] == 0.0
    np.testing.assert_allclose(np.delete(weights, 7), 1 / 8191, rtol=1e-4)


def test_a_wrong_place_is_left_however_long_it_was_believed(drive, amcl):
    """A start far off: there is no better past to compare with, and the scans do not lie on the map."""
    _, prepared, truth = drive
    wrong = np.array([truth[0, 0] + 2.0, truth[0, 1] + 2.0, truth[0, 2] + 2.0])
    start = start_at(amcl, jax.random.key(1), tuple(wrong), (0.1, 0.05))
    _, infos = jax.jit(run_steps)(amcl, prepared.inputs, jax.random.key(1), start)
    lost, num_random = np.asarray(infos.lost), np.asarray(infos.num_random)
    first = int(np.argmax(lost))
    assert lost[first]
    expected = amcl.recovery.lost_share * int(infos.num_particles[first + 1])
    assert num_random[first] == pytest.approx(expected, rel=0.2)
    found = np.hypot(*(np.asarray(infos.estimate.mean) - truth)[:, :2].T)
    assert found[0] > 1.0
    assert found[-5:].max() < 0.3


def test_the_share_of_random_particles_is_the_recoverys(drive, amcl):
    _, prepared, truth = drive
    averages = Averages(*(jnp.float32(value) for value in (0.8, 0.3, 1.0, 1.0)))
    state = dataclasses.replace(start_at(amcl, KEY, tuple(truth[0]), (0.3, 0.1)), averages=averages)
    frozen = dataclasses.replace(
        amcl, recovery=Recovery(slow=1e-6, fast=2e-6), sampling=KLDSampling(error=0.002)
    )
    after, info = jax.jit(AMCL.step)(frozen, KEY, state, at(prepared, 0))
    expected = 1 - 0.3 / (0.85 * 0.8)
    count = int(after.num_particles)
    assert count > 2000
    deviation = np.sqrt(expected * (1 - expected) / count)
    assert int(info.num_random) / count == pytest.approx(expected, abs=4 * deviation)


def test_the_set_grows_by_one_stage_at_a_time(amcl):
    assert amcl._sizes() == [512, 2048, 8192]
    assert dataclasses.replace(amcl, max_particles=100_000)._sizes() == [1562, 6250, 25_000, 100_000]
    assert dataclasses.replace(amcl, max_particles=300)._sizes() == [300]


def resampled(amcl, poses, log_weights, random_share):
    """How many, all that were drawn, and how many of those that count are random."""
    resample = jax.jit(AMCL._resample, static_argnums=5)
    count, drawn, log_weights, num_random = resample(
        amcl, KEY, poses, normalize(log_weights), jnp.float32(random_share), 8192
    )
    np.testing.assert_allclose(log_weights, -np.log(int(count)), rtol=1e-6)
    return int(count), np.asarray(drawn), int(num_random)


def test_random_particles_come_in_the_right_share(amcl):
    poses = jnp.tile(jnp.asarray([[3.0, 2.0, 0.5]], jnp.float32), (8192, 1))
    count, drawn, num_random = resampled(amcl, poses, jnp.zeros(8192), 0.3)
    random = np.any(drawn != np.asarray(poses[0]), axis=1)
    # Three deviations of a binomial of 8192.
    assert np.mean(random) == pytest.approx(0.3, abs=3 * np.sqrt(0.21 / 8192))
    assert count > 200
    assert num_random == random[:count].sum()


def test_resampling_is_unbiased(amcl):
    poses = jnp.stack([jnp.arange(4.0) + 1.0, jnp.full(4, 2.0), jnp.zeros(4)], axis=1)
    weights = jnp.asarray([0.1, 0.2, 0.3, 0.4])
    few = dataclasses.replace(amcl, sampling=dataclasses.replace(amcl.sampling, min_particles=20.0))
    count, drawn, num_random = resampled(few, poses, jnp.log(weights), 0.0)
    # The bound for four bins: ε 0.05 and z 2.326, 3 / 0.1 · (1 − 2/27 + √(2/27) · 2.326)³ = 113.7.
    assert count == 114
    assert num_random == 0
    shares = np.array([np.mean(drawn[:, 0] == x) for x in (1, 2, 3, 4)])
    np.testing.assert_allclose(shares, weights, atol=3 * np.sqrt(0.25 / 8192))


def test_jumps_are_found():
    odometry = np.stack([np.arange(5.0), np.zeros(5), np.zeros(5)], axis=1)
    turned = np.stack([np.zeros(5), np.arange(5.0), np.full(5, np.pi / 2)], axis=1)
    assert find_jumps(turned, odometry).tolist() == []
    jumped = turned.copy()
    jumped[3:, 0] += 4.0
    assert find_jumps(jumped, odometry).tolist() == [3]
    spun = turned.copy()
    spun[4, 2] += np.pi
    assert find_jumps(spun, odometry).tolist() == [4]
    assert find_jumps(turned[:1], odometry[:1]).tolist() == []


@pytest.mark.parametrize(
    ("pose", "message"),
    [
        ((500.0, 0.0, 0.0), r"is not on the map, which is 19 × 16 m from \(-0.5, -0.5\)"),
        (WALL, "is in a wall"),
        ((-0.3, -0.3, 0.0), "in unknown space"),
    ],
)
def test_a_start_that_cannot_be_is_refused(amcl, pose, message):
    with pytest.raises(ValueError, match=message):
        start_at(amcl, KEY, pose, (0.1, 0.1))


def test_states_go_round_without_compiling_again(drive, amcl):
    """A weak type in a state that comes out would make the next call another program."""
    _, prepared, truth = drive
    state = start_at(amcl, KEY, tuple(truth[0]), (0.1, 0.05))
    after, info = jax.eval_shape(AMCL.step, amcl, KEY, state, at(prepared, 3))
    chex.assert_trees_all_equal_shapes_and_dtypes(after, state)
    assert_strongly_typed((state, after, info))


def test_one_compilation_serves_every_float(drive, amcl):
    _, prepared, truth = drive
    state = start_at(amcl, KEY, tuple(truth[0]), (0.1, 0.05))
    step = jit_once(lambda one, key, state, inputs: one.step(key, state, inputs))
    changed = eqx.tree_at(
        lambda a: (a.recovery.slow, a.sampling.error, a.resample_below), amcl, (0.02, 0.1, 0.8)
    )
    for one in (amcl, changed):
        step(one, KEY, state, at(prepared, 3))
