"""The filter's contract: types, compilation, determinism, maps that follow their particles, bad input."""

import chex
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.core.flags import Flag
from jaxslam.core.types import StepInputs
from jaxslam.grid import GridSpec, OccupancyModel, quantize
from jaxslam.matching import CorrelativeSearch
from jaxslam.motion import OdometryMotion
from jaxslam.proposal import MatchedProposal, MotionProposal
from jaxslam.resampling import AdaptiveResampling, SystematicResampler
from jaxslam.sensor import LikelihoodField
from jaxslam.slam import RBPF, StepInfo, trajectory
from tests import builders
from tests.checks import assert_strongly_typed, jit_once

NUM_PARTICLES, NUM_BEAMS, NUM_STEPS, SIZE = 4, 32, 6, 64
POSE0 = jnp.asarray([-0.6, -0.2, 0.1], jnp.float32)
# A small search lattice: what it finds is the matcher's own tests' matter.
SEARCH = CorrelativeSearch(num_translations=5, num_rotations=5)
PROPOSALS = {"motion": MotionProposal(), "matched": MatchedProposal(max_beams=NUM_BEAMS, search=SEARCH)}
every_proposal = pytest.mark.parametrize("proposal", PROPOSALS)


def filter_of(proposal="motion", threshold=0.5, num_particles=NUM_PARTICLES) -> RBPF:
    side = np.array([5.0, 5.0])
    return RBPF(
        grid=GridSpec.covering(-side, side, 0.1),
        motion=OdometryMotion(),
        sensor=LikelihoodField(max_beams=NUM_BEAMS, independent_beams=0.5 * NUM_BEAMS),
        proposal=PROPOSALS[proposal],
        resampling=AdaptiveResampling(SystematicResampler(), threshold),
        occupancy=OccupancyModel(),
        usable_range=4.0,
        num_particles=num_particles,
        window_size=SIZE,
    )


def inputs_of(num_steps=NUM_STEPS, step=(0.15, 0.02, 0.05)) -> StepInputs:
    """The robot drives an arc; leaves `[T, ...]`. The first increment is zero."""
    angles = -np.pi + 2 * np.pi / NUM_BEAMS * np.arange(NUM_BEAMS)
    pose, ranges, deltas = np.asarray(POSE0, float), [], []
    for index in range(num_steps):
        delta = np.array(step) * (index > 0)
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        moved = np.array([cos * delta[0] - sin * delta[1], sin * delta[0] + cos * delta[1], delta[2]])
        pose = pose + moved
        deltas.append(delta)
        # Nothing is in the room from (−2, −1.5) to (2, 1.5).
        ranges.append(builders.room_ranges(pose, angles, np.array([2.0, 1.5])))
    return builders.inputs_of(np.array(deltas), np.array(ranges), angle_min=-np.pi)


def one(inputs, index):
    return jax.tree.map(lambda leaf: leaf[index], inputs)


def run_filter(slam, key, inputs):
    key_init, key_run = jax.random.split(key)
    keys = jax.random.split(key_run, inputs.odometry.dt.shape[0])
    state = slam.init(key_init, POSE0)
    return jax.lax.scan(lambda state, x: slam.step(x[0], state, x[1]), state, (keys, inputs))


init, step = jax.jit(RBPF.init), jax.jit(RBPF.step)


def run(slam, key, inputs, step=step):
    """`run_filter` as a loop on the host: every number of steps shares the compilation of one."""
    key_init, key_run = jax.random.split(key)
    state, infos = init(slam, key_init, POSE0), []
    for index, key_step in enumerate(jax.random.split(key_run, inputs.odometry.dt.shape[0])):
        state, info = step(slam, key_step, state, one(inputs, index))
        infos.append(info)
    return state, jax.tree.map(lambda *leaves: jnp.stack(leaves), *infos)


def assert_finite(state):
    chex.assert_tree_all_finite(state)
    assert np.exp(np.asarray(state.log_weights)).sum() == pytest.approx(1.0, abs=1e-5)


@every_proposal
def test_a_step_keeps_every_type(proposal):
    slam, key = filter_of(proposal), jax.random.key(0)
    state = jax.eval_shape(slam.init, key, POSE0)
    after, info = jax.eval_shape(slam.step, key, state, one(inputs_of(), 0))
    chex.assert_trees_all_equal_shapes_and_dtypes(after, state)
    assert_strongly_typed((state, after, info))


@every_proposal
def test_a_run_maps_the_room(proposal):
    state, infos = run(filter_of(proposal), jax.random.key(1), inputs_of())
    assert_finite(state)
    assert int(state.num_steps) == NUM_STEPS
    assert state.maps.shape == (NUM_PARTICLES, 100, 100)
    np.testing.assert_allclose(np.exp(np.asarray(infos.log_weights)).sum(axis=1), 1.0, atol=1e-5)
    assert (np.asarray(infos.ess) >= 1.0 - 1e-4).all()
    assert (np.asarray(infos.ess) <= NUM_PARTICLES + 1e-3).all()
    assert (np.asarray(infos.flags) & ~Flag.SEARCHED == 0).all()
    # The start is free, the walls to the right and left are where the room has them, beyond is unknown.
    for grid in np.asarray(state.maps):
        assert grid[48, 44] < 0
        assert grid[45:52, 68:72].max() > 0
        assert grid[45:52, 28:32].max() > 0
        assert (grid[:, :20] == 0).all()


@every_proposal
def test_first_step_stays_where_the_odometry_says(proposal):
    slam, inputs = filter_of(proposal), inputs_of(1)
    _, info = step(slam, jax.random.key(5), slam.init(jax.random.key(0), POSE0), one(inputs, 0))
    np.testing.assert_allclose(info.poses, np.tile(POSE0, (NUM_PARTICLES, 1)), atol=1e-6)


def test_jit_changes_nothing():
    slam, inputs, key = filter_of(), inputs_of(), jax.random.key(2)
    state, _ = run(slam, key, one(inputs, slice(0, 3)))
    jitted, info_jitted = step(slam, key, state, one(inputs, 3))
    plain, info_plain = slam.step(key, state, one(inputs, 3))
    # A meter in float32 is 1e-7 m; a cell's edge moves single cells.
    np.testing.assert_allclose(info_jitted.poses, info_plain.poses, atol=1e-4)
    np.testing.assert_allclose(info_jitted.log_weights, info_plain.log_weights, atol=0.02)
    np.testing.assert_array_equal(info_jitted.ancestors, info_plain.ancestors)
    assert np.mean(np.asarray(jitted.maps) != np.asarray(plain.maps)) < 1e-3


def test_same_key_same_bytes_and_another_key_another_result():
    slam, inputs = filter_of(), inputs_of()
    first, again, other = (run(slam, jax.random.key(seed), inputs) for seed in (3, 3, 4))
    for one_leaf, other_leaf in zip(jax.tree.leaves(first), jax.tree.leaves(again), strict=True):
        assert np.asarray(one_leaf).tobytes() == np.asarray(other_leaf).tobytes()
    assert (np.asarray(first[0].poses) != np.asarray(other[0].poses)).any()


def test_new_floats_do_not_recompile():
    slam, inputs = filter_of("matched"), inputs_of(2)
    step = jit_once(lambda slam, key, state, inputs: slam.step(key, state, inputs))
    run(slam, jax.random.key(0), inputs, step)
    # Every float of the whole filter at once.
    run(jax.tree.map(lambda value: value * 1.01, slam), jax.random.key(1), inputs, step)
    run(slam, jax.random.key(2), inputs_of(2, (0.3, 0.1, 0.2)), step)


def test_vmap_over_seeds_is_the_loop():
    slam, inputs = filter_of("matched"), inputs_of(3)
    keys = jax.random.split(jax.random.key(6), 2)
    _, together = jax.jit(jax.vmap(run_filter, (None, 0, None)))(slam, keys, inputs)
    for index, key in enumerate(keys):
        _, alone = run(slam, key, inputs)
        np.testing.assert_allclose(together.poses[index], alone.poses, atol=1e-3)
        np.testing.assert_allclose(together.log_weights[index], alone.log_weights, atol=0.05)


def test_vmap_over_a_float_is_the_loop():
    inputs, key, where = inputs_of(3), jax.random.key(6), lambda slam: slam.sensor.sigma_hit
    sigmas = jnp.asarray([0.05, 0.2], jnp.float32)

    def run_with(sigma):
        return run_filter(eqx.tree_at(where, filter_of(), sigma), key, inputs)[1]

    together = jax.jit(jax.vmap(run_with))(sigmas)
    one_by_one = [run(eqx.tree_at(where, filter_of(), sigma), key, inputs)[1] for sigma in sigmas]
    for index, alone in enumerate(one_by_one):
        np.testing.assert_allclose(together.poses[index], alone.poses, atol=1e-4)
        np.testing.assert_allclose(together.log_weights[index], alone.log_weights, atol=0.02)
    assert np.abs(np.asarray(one_by_one[0].log_weights - one_by_one[1].log_weights)).max() > 0.05


def test_maps_follow_their_ancestors():
    """Always resampling: each slot's map is its ancestor's, told apart by a mark put into it."""
    slam, inputs = filter_of(threshold=2.0), inputs_of(2)
    state = slam.init(jax.random.key(0), POSE0)
    marks = jnp.arange(1, NUM_PARTICLES + 1, dtype=jnp.int8)
    weights = jnp.log(jnp.asarray([0.03, 0.55, 0.03, 0.39], jnp.float32))
    state = eqx.tree_at(
        lambda s: (s.maps, s.log_weights), state, (state.maps.at[:, 0, 0].set(marks), weights)
    )
    after, info = step(slam, jax.random.key(1), state, one(inputs, 1))
    ancestors = np.asarray(info.ancestors)
    assert bool(info.resampled)
    assert len(set(ancestors)) < NUM_PARTICLES
    np.testing.assert_array_equal(after.maps[:, 0, 0], np.asarray(marks)[ancestors])
    np.testing.assert_array_equal(after.poses, np.asarray(info.poses)[ancestors])
    np.testing.assert_allclose(after.log_weights, -np.log(NUM_PARTICLES), atol=1e-6)


def test_without_resampling_every_particle_goes_on_from_itself():
    _, infos = run(filter_of(threshold=0.0), jax.random.key(1), inputs_of())
    assert not np.asarray(infos.resampled).any()
    np.testing.assert_array_equal(infos.ancestors, np.tile(np.arange(NUM_PARTICLES), (NUM_STEPS, 1)))


def test_trajectory_is_read_back_through_the_ancestors():
    random = np.random.default_rng(0)
    poses = random.normal(size=(7, 4, 3)).astype(np.float32)
    ancestors = random.integers(0, 4, (7, 4)).astype(np.int32)
    steps = [
        StepInfo(
            poses=jnp.asarray(poses[time]),
            log_weights=jnp.zeros(4),
            ancestors=jnp.asarray(ancestors[time]),
            ess=jnp.float32(1.0),
            resampled=jnp.asarray(True),
            flags=jnp.int32(0),
        )
        for time in range(7)
    ]
    infos = jax.tree.map(lambda *leaves: jnp.stack(leaves), *steps)
    for particle in range(4):
        expected, slot = [], particle
        for time in range(6, -1, -1):
            slot = ancestors[time, slot]
            expected.append(poses[time, slot])
        found = trajectory(infos, jnp.int32(particle))
        np.testing.assert_array_equal(found, expected[::-1])


@every_proposal
def test_a_scan_without_returns_is_odometry_alone(proposal):
    slam, inputs = filter_of(proposal), inputs_of()
    state, _ = run(slam, jax.random.key(1), one(inputs, slice(0, 3)))
    blind = eqx.tree_at(
        lambda i: (i.scan.valid, i.scan.ranges),
        one(inputs, 3),
        (jnp.zeros(NUM_BEAMS, bool), jnp.zeros(NUM_BEAMS)),
    )
    after, info = step(slam, jax.random.key(2), state, blind)
    assert_finite(after)
    np.testing.assert_array_equal(after.maps, np.asarray(state.maps)[np.asarray(info.ancestors)])
    np.testing.assert_allclose(info.log_weights, state.log_weights, atol=1e-5)
    if proposal == "matched":
        assert int(info.flags) & Flag.FEW_VALID_BEAMS
    # And the filter goes on.
    assert_finite(step(slam, jax.random.key(3), after, one(inputs, 4))[0])


@every_proposal
@pytest.mark.parametrize("broken", [(np.nan, 0.0, 0.0), (0.1, 0.0, np.nan), (np.inf, 0.0, 0.0)])
def test_broken_odometry_is_flagged_and_does_not_poison_the_state(proposal, broken):
    slam, inputs = filter_of(proposal), inputs_of()
    state, _ = run(slam, jax.random.key(1), one(inputs, slice(0, 3)))
    bad = eqx.tree_at(lambda i: i.odometry.delta, one(inputs, 3), jnp.asarray(broken, jnp.float32))
    after, info = step(slam, jax.random.key(2), state, bad)
    assert_finite(after)
    assert int(info.flags) & Flag.NONFINITE_POSE
    assert_finite(step(slam, jax.random.key(3), after, one(inputs, 4))[0])


def test_a_weight_that_is_not_a_number_is_flagged_and_gets_no_weight():
    slam, inputs = filter_of(threshold=0.0), inputs_of()
    state, _ = run(slam, jax.random.key(1), one(inputs, slice(0, 3)))
    state = eqx.tree_at(lambda s: s.log_weights, state, state.log_weights.at[1].set(jnp.nan))
    after, info = step(slam, jax.random.key(2), state, one(inputs, 3))
    assert int(info.flags) & Flag.NONFINITE_WEIGHT
    weights = np.exp(np.asarray(after.log_weights))
    assert weights[1] == 0.0
    assert weights.sum() == pytest.approx(1.0, abs=1e-5)


def test_one_particle_is_enough():
    state, infos = run(filter_of(num_particles=1), jax.random.key(1), inputs_of(3))
    assert_finite(state)
    np.testing.assert_allclose(infos.ess, 1.0, atol=1e-5)
    np.testing.assert_array_equal(infos.ancestors, np.zeros((3, 1)))


def test_leaving_the_map_is_flagged():
    # The map's right edge is moved to x = 4 m.
    slam = filter_of()
    slam = eqx.tree_at(lambda s: s.grid.origin, slam, slam.grid.origin - jnp.asarray([1.0, 0.0]))
    state, infos = run(slam, jax.random.key(1), inputs_of(4, (0.9, 0.0, 0.0)))
    off_map = (np.asarray(infos.flags) & Flag.OFF_MAP) != 0
    # A window of 6.4 m reaches 3.2 m: over the edge from x = 0.8 m on; the robot starts at −0.6 m. At 1.2 m
    # the far wall behind it draws the window back by 1.2 m.
    np.testing.assert_array_equal(off_map, [False, False, False, True])
    assert_finite(state)


def test_longer_returns_clear_and_do_not_hit():
    slam = eqx.tree_at(lambda s: s.usable_range, filter_of(), 1.0)
    state = slam.init(jax.random.key(0), jnp.zeros(3, jnp.float32))
    after, _ = step(slam, jax.random.key(0), state, one(inputs_of(), 0))
    # The room is wider than 1 m on every side but for the wall 1.3 m away.
    assert set(np.unique(after.maps)) == {0, int(quantize(slam.occupancy.miss))}


def test_returns_beyond_the_usable_range_do_not_weigh():
    """They are shortened to it and end in free space: not a likelihood, whatever the pose."""
    inputs = inputs_of()
    state, _ = run(filter_of(), jax.random.key(1), one(inputs, slice(0, 3)))
    # No wall is nearer than 1.2 m, and the shortened ends come within the field of the nearest.
    slam = eqx.tree_at(lambda s: s.usable_range, filter_of(threshold=0.0), 1.0)
    _, info = step(slam, jax.random.key(2), state, one(inputs, 3))
    np.testing.assert_allclose(info.log_weights, state.log_weights, atol=1e-5)
