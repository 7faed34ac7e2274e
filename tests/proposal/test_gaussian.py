"""The second paper's proposal: its weight, and what the odometry term is for."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.core import se2
from jaxslam.lidar.beams import scan_points
from jaxslam.motion import OdometryMotion
from jaxslam.proposal import GaussianProposal, MatchedProposal, ProposalContext
from jaxslam.sensor import LikelihoodField
from tests.builders import field_of, inputs_of

NUM_BEAMS = 60
SENSOR = LikelihoodField(sigma_hit=0.05, independent_beams=20.0, max_beams=NUM_BEAMS)
# 2 cm along the way and 0.5°: what is left of odometry that has been fused.
MOTION = OdometryMotion(1e-4, 1e-5, 1e-4, 1e-5, 0.005, 0.02, 0.008)
DELTA = (0.2, 0.0, 0.0)
PROPOSAL = GaussianProposal(matcher=MatchedProposal(max_beams=NUM_BEAMS))


def corridor():
    """Two walls along x, 1.5 m apart and 20 m long, without a feature; the middle is the origin."""
    occupied = np.zeros((61, 401), bool)
    occupied[[15, 45], :] = True
    return field_of(occupied, (-10.025, -1.525), 0.05)


FIELD = corridor()


def context():
    """What a lidar sees within 4 m of where the odometry leads from the origin."""
    angles = 2 * np.pi / NUM_BEAMS * np.arange(NUM_BEAMS)
    with np.errstate(divide="ignore"):
        ranges = np.abs(0.75 / np.sin(angles))
    inputs = inputs_of(DELTA, np.where(ranges < 4.0, ranges, 0.0))
    return ProposalContext(inputs.odometry, inputs.scan, FIELD, MOTION, SENSOR)


@jax.jit
def sample_many(proposal, keys):
    start = jnp.zeros(3, jnp.float32)
    return jax.vmap(lambda key: proposal.sample(key, start, context()))(keys)


@pytest.mark.parametrize("sharpness", [1.0, 30.0])
def test_the_weight_is_the_mean_likelihood_of_the_modes_surroundings(sharpness):
    """Mine (22), at sharpness 1; above it the mean is of powers, and blunted."""
    proposal = dataclasses.replace(
        PROPOSAL, sharpness=jnp.float32(sharpness), odometry_weight=jnp.float32(0.0)
    )
    keys = jax.random.split(jax.random.key(2), 8)
    proposed = sample_many(proposal, keys)

    @jax.jit
    def expected(key):
        mode = proposal.matcher.sample(key, jnp.zeros(3), context()).pose
        ends = scan_points(context().scan, NUM_BEAMS)
        drawn = jax.random.uniform(jax.random.fold_in(key, 1), (25, 3), jnp.float32, -1.0, 1.0)
        shape = proposal.around._shape(ends, mode)
        poses = mode[None] + jnp.concatenate([drawn, -drawn]) @ shape.T
        likelihoods = jnp.exp(jax.vmap(lambda p: SENSOR.log_prob(FIELD, context().scan, p))(poses))
        return jnp.log(jnp.mean(likelihoods**sharpness)) / sharpness

    for index, key in enumerate(keys):
        weight = float(proposed.log_likelihood[index] + proposed.log_ratio[index])
        assert weight == pytest.approx(float(expected(key)), abs=1e-3)


def test_odometry_holds_the_particles_along_a_corridor_without_features():
    keys = jax.random.split(jax.random.key(3), 400)
    predicted = np.asarray(se2.compose(jnp.zeros(3), jnp.asarray(DELTA)))
    held, free = (
        np.asarray(sample_many(dataclasses.replace(PROPOSAL, odometry_weight=jnp.float32(weight)), keys).pose)
        - predicted
        for weight in (1.0, 0.0)
    )
    # The motion model's own deviation along the way is some 2 cm.
    assert held[:, 0].std() < 0.04
    assert free[:, 0].std() > 2 * held[:, 0].std()
    for offsets in (held, free):
        assert offsets[:, 1].std() < 0.01
        assert np.abs(offsets[:, 1].mean()) < 0.01
