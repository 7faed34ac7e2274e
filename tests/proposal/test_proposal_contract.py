"""What every proposal must do, over a registry of all of them."""

import dataclasses

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxslam.proposal
from jaxslam.core import se2
from jaxslam.core.flags import Flag
from jaxslam.core.types import StepInputs
from jaxslam.matching.swarm import FruitFlies
from jaxslam.motion import GaussianMotion, OdometryMotion
from jaxslam.proposal import (
    AbstractProposal,
    FruitFlyProposal,
    GaussianProposal,
    MatchedProposal,
    MotionProposal,
    ProposalContext,
)
from jaxslam.sensor import LikelihoodField
from tests import builders
from tests.checks import assert_strongly_typed, jit_once

NUM_BEAMS = 36
PROPOSALS = {
    "motion": MotionProposal(),
    "matched": MatchedProposal(max_beams=NUM_BEAMS),
    "gaussian": GaussianProposal(matcher=MatchedProposal(max_beams=NUM_BEAMS)),
    "fruit_fly": FruitFlyProposal(max_beams=NUM_BEAMS, flies=FruitFlies(8, 4)),
    "fruit_fly_density": FruitFlyProposal(max_beams=NUM_BEAMS, flies=FruitFlies(8, 4), weight="density"),
    "fruit_fly_together": FruitFlyProposal(max_beams=NUM_BEAMS, flies=FruitFlies(8, 4), swarm="particles"),
}
every_proposal = pytest.mark.parametrize("proposal", PROPOSALS.values(), ids=PROPOSALS.keys())
POSE = jnp.asarray([0.2, -0.3, 0.4], jnp.float32)
DELTA = jnp.asarray([0.3, 0.0, 0.1], jnp.float32)
TRUTH = np.asarray(se2.compose(POSE, DELTA), np.float64)
MOTION, SENSOR = (
    OdometryMotion(),
    LikelihoodField(sigma_hit=0.05, independent_beams=0.5 * NUM_BEAMS, max_beams=NUM_BEAMS),
)


# A room from (−2.5, −1.5) to (2.5, 1.5), in 0.1 m cells whose centers lie on the walls.
ROOM, CORNER = np.array([2.5, 1.5]), np.array([-3.05, -2.05])
FIELD = builders.field_of(builders.room_cells((41, 61), CORNER, 0.1, (-ROOM, ROOM)), CORNER)


def inputs_of(valid=True) -> StepInputs:
    angles = 2 * np.pi / NUM_BEAMS * np.arange(NUM_BEAMS)
    ranges = builders.room_ranges(TRUTH, angles, ROOM)
    return builders.inputs_of(DELTA, ranges * valid, dt=0.5)


def context_of(inputs, field=FIELD, motion=MOTION, sensor=SENSOR) -> ProposalContext:
    return ProposalContext(inputs.odometry, inputs.scan, field, motion, sensor)


@jax.jit
def jitted_sample(proposal, key, pose, inputs, motion, sensor):
    return proposal.sample(key, pose, context_of(inputs, FIELD, motion, sensor))


def sample(proposal, key, pose, inputs):
    return jitted_sample(proposal, key, pose, inputs, MOTION, SENSOR)


@jax.jit
def sample_many(proposal, keys, poses, inputs):
    fields = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (len(poses), *leaf.shape)), FIELD)
    return proposal.sample_all(keys, poses, context_of(inputs, fields))


def test_every_proposal_is_registered():
    public = {getattr(jaxslam.proposal, name) for name in jaxslam.proposal.__all__}
    proposals = {p for p in public if issubclass(p, AbstractProposal)} - {AbstractProposal}
    assert proposals == {type(p) for p in PROPOSALS.values()} == set(AbstractProposal.__subclasses__())


@every_proposal
def test_outputs_are_strongly_typed(proposal):
    proposed = jax.eval_shape(sample, proposal, jax.random.key(0), POSE, inputs_of())
    number, flags = jax.ShapeDtypeStruct((), jnp.float32), jax.ShapeDtypeStruct((), jnp.int32)
    expected = [jax.ShapeDtypeStruct((3,), jnp.float32), number, number, flags]
    chex.assert_trees_all_equal_shapes_and_dtypes(jax.tree.leaves(proposed), expected)
    assert_strongly_typed(proposed)


@every_proposal
def test_the_log_likelihood_is_the_sensor_models_at_the_pose(proposal):
    proposed = sample(proposal, jax.random.key(3), POSE, inputs_of())
    expected = SENSOR.log_prob(FIELD, inputs_of().scan, proposed.pose)
    np.testing.assert_allclose(proposed.log_likelihood, expected, rtol=1e-5)


@every_proposal
def test_jit_and_vmap_change_nothing(proposal):
    if getattr(proposal, "swarm", "own") == "particles":
        proposal = dataclasses.replace(proposal, use_flies=False)
    keys, poses = jax.random.split(jax.random.key(1), 3), jnp.tile(POSE[None], (3, 1))
    together = sample_many(proposal, keys, poses, inputs_of())
    for index, key in enumerate(keys):
        alone = sample(proposal, key, POSE, inputs_of())
        np.testing.assert_allclose(together.pose[index], alone.pose, atol=1e-3)
        assert int(together.flags[index]) == int(alone.flags)
    # Without jit each operation compiles by itself (40 s for the matcher).
    if isinstance(proposal, MotionProposal):
        plain = proposal.sample(keys[0], POSE, context_of(inputs_of()))
        np.testing.assert_allclose(plain.pose, together.pose[0], atol=1e-3)


@every_proposal
def test_new_parameter_values_do_not_recompile(proposal):
    traced = jit_once(lambda *arguments: jitted_sample(*arguments))
    traced.eval_shape(proposal, jax.random.key(0), POSE, inputs_of(), MOTION, SENSOR)
    changed, motion, sensor = jax.tree.map(lambda value: value * 1.1, (proposal, MOTION, SENSOR))
    traced.eval_shape(changed, jax.random.key(1), POSE, inputs_of(), motion, sensor)


@every_proposal
def test_draws_lie_around_the_truth_and_differ(proposal):
    keys, poses = jax.random.split(jax.random.key(2), 16), jnp.tile(POSE[None], (16, 1))
    proposed = sample_many(proposal, keys, poses, inputs_of())
    assert np.abs(np.asarray(proposed.pose).mean(axis=0) - TRUTH).max() < 0.06
    assert len({row.tobytes() for row in np.asarray(proposed.pose)}) == 16
    assert np.isfinite(proposed.log_ratio).all()
    assert not np.asarray(proposed.flags).any()


@pytest.mark.parametrize(
    "matching", ["matched", "gaussian", "fruit_fly", "fruit_fly_density", "fruit_fly_together"]
)
def test_matching_brings_the_draws_together_at_the_truth(matching):
    keys, poses = jax.random.split(jax.random.key(3), 16), jnp.tile(POSE[None], (16, 1))
    drawn, matched = (
        np.asarray(sample_many(PROPOSALS[name], keys, poses, inputs_of()).pose)
        for name in ("motion", matching)
    )
    # Half a cell is what matching may leave: the prior still pulls towards each draw.
    assert np.abs(matched - TRUTH).max() < 0.05
    assert (matched.std(axis=0) < drawn.std(axis=0)).all()


@every_proposal
def test_a_blind_scan_leaves_the_motion_models_draw(proposal):
    key = jax.random.key(4)
    proposed = sample(proposal, key, POSE, inputs_of(valid=False))
    drawn = MOTION.sample(key, POSE, inputs_of().odometry)
    np.testing.assert_allclose(proposed.pose, drawn, atol=1e-6)
    few = 0 if isinstance(proposal, MotionProposal) else Flag.FEW_VALID_BEAMS
    assert int(proposed.flags) == few


@pytest.mark.parametrize("matching", ["matched", "fruit_fly"])
def test_a_lost_particle_searches_and_says_so(matching):
    lost = POSE + jnp.asarray([0.7, 0.5, 0.35], jnp.float32)
    matched = dataclasses.replace(PROPOSALS[matching], lost_below=1.1)
    proposed = sample(matched, jax.random.key(5), lost, inputs_of())
    assert int(proposed.flags) == Flag.SEARCHED


@pytest.mark.parametrize(
    "changed",
    [
        {"use_icp": False},
        {"use_flies": False},
        {"polish": False},
        {"flies": FruitFlies.standard(8, 4)},
        {"flies": FruitFlies(8, 4, crossover=False)},
        {"flies": FruitFlies(1, 3)},
        {"flies": FruitFlies(8, 0)},
        {"swarm": "particles", "flies": FruitFlies(8, 0)},
    ],
    ids=str,
)
def test_every_stage_of_the_fruit_flies_can_be_switched_off(changed):
    """And none makes the particle worse than the motion model's draw, by the score that it compares."""
    proposal = dataclasses.replace(PROPOSALS["fruit_fly"], **changed)
    keys, poses = jax.random.split(jax.random.key(6), 8), jnp.tile(POSE[None], (8, 1))
    proposed = sample_many(proposal, keys, poses, inputs_of())
    drawn = sample_many(PROPOSALS["motion"], keys, poses, inputs_of())
    assert np.all(np.asarray(proposed.log_likelihood) > np.asarray(drawn.log_likelihood) - 1e-4)


def test_a_swarm_of_particles_is_no_worse_than_none():
    """The particles as one swarm, in their own maps: none ends below where ICP had brought it."""
    together = PROPOSALS["fruit_fly_together"]
    alone = dataclasses.replace(together, use_flies=False)
    keys = jax.random.split(jax.random.key(7), 8)
    # Headings to either side of ±π: crossed as numbers, they would meet at 0.
    poses = jnp.tile(POSE.at[2].set(np.pi - 0.1)[None], (8, 1))
    with_flies, without = (sample_many(p, keys, poses, inputs_of()) for p in (together, alone))
    assert np.all(np.asarray(with_flies.log_likelihood) > np.asarray(without.log_likelihood) - 0.2)
    assert np.abs(np.asarray(se2.wrap(with_flies.pose[:, 2] - without.pose[:, 2]))).max() < 0.35


@pytest.mark.parametrize("matching", ["matched", "gaussian", "fruit_fly"])
def test_a_scan_corrects_odometry_that_claims_to_be_better_than_the_map(matching):
    """An increment that is 3 cm off and says that it is good to 2 mm, as a biased one may."""
    inputs = inputs_of()
    off = dataclasses.replace(inputs.odometry, delta=DELTA + jnp.asarray([0.0, 0.03, 0.0], jnp.float32))
    inputs = dataclasses.replace(inputs, odometry=off)
    motion = GaussianMotion(translation_floor=0.002, rotation_floor=0.002)
    proposed = jitted_sample(PROPOSALS[matching], jax.random.key(9), POSE, inputs, motion, SENSOR)
    assert np.hypot(*(np.asarray(proposed.pose) - TRUTH)[:2]) < 0.015


def test_weights_by_the_density_undo_where_the_draws_lie():
    """Likelihood × ratio varies less than either: p and q fall together away from the mode."""
    proposal = dataclasses.replace(PROPOSALS["fruit_fly_density"], sharpness=jnp.float32(1.0))
    keys, poses = jax.random.split(jax.random.key(8), 64), jnp.tile(POSE[None], (64, 1))
    proposed = sample_many(proposal, keys, poses, inputs_of())
    weights = np.asarray(proposed.log_likelihood + proposed.log_ratio)
    assert weights.std() < np.asarray(proposed.log_ratio).std()


def test_the_gaussian_weighs_by_eta():
    """Mine (22): the weight is that of the mode's surroundings, whichever pose was drawn there."""
    keys, poses = jax.random.split(jax.random.key(8), 64), jnp.tile(POSE[None], (64, 1))
    proposal = dataclasses.replace(PROPOSALS["gaussian"], odometry_weight=jnp.float32(0.0))
    proposed = sample_many(proposal, keys, poses, inputs_of())
    likelihood, eta = (
        np.asarray(proposed.log_likelihood),
        np.asarray(proposed.log_likelihood + proposed.log_ratio),
    )
    # A mean of likelihoods that a sharp one dominates: near the best, and no draw's own.
    assert eta.max() <= likelihood.max() + 0.5
    assert eta.min() > likelihood.min() - 1.5
    assert abs(np.corrcoef(likelihood, eta)[0, 1]) < 0.6


def test_a_match_that_fails_falls_back_to_the_motion_model():
    proposal = dataclasses.replace(PROPOSALS["gaussian"], failed_below=1.1)
    key = jax.random.key(5)
    proposed = sample(proposal, key, POSE, inputs_of())
    np.testing.assert_allclose(proposed.pose, MOTION.sample(key, POSE, inputs_of().odometry), atol=1e-6)
    assert int(proposed.flags) == Flag.MATCH_FAILED
    assert float(proposed.log_ratio) == 0.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"weight": "none"}, "weight is 'none', must be one of likelihood, density"),
        ({"swarm": "all"}, "swarm is 'all', must be one of own, particles"),
        ({"sharpness": 0.0}, "sharpness is 0.0"),
    ],
)
def test_choices_that_there_are_not_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        FruitFlyProposal(**arguments)
