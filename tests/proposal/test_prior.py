"""How much a match trusts the motion model."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.motion import GaussianMotion
from jaxslam.proposal.prior import PriorTrust
from tests.builders import odometry_of

TRUST = PriorTrust(translation=1.0, rotation=1.0, least_translation=0.02, least_rotation=0.01)
TINY = GaussianMotion(translation_floor=1e-4, rotation_floor=1e-4)


def deviations(covariance, heading=0.0, trust=TRUST):
    """Standard deviations along the robot, across it and in heading that the prior has."""
    odometry = odometry_of(np.zeros(3), covariance)
    prior = trust.around(TINY, odometry, jnp.asarray([1.0, 2.0, heading], jnp.float32))
    turn = np.array(
        [[np.cos(heading), -np.sin(heading), 0], [np.sin(heading), np.cos(heading), 0], [0, 0, 1]]
    )
    return np.sqrt(np.diag(turn.T @ np.linalg.inv(np.asarray(prior.precision, np.float64)) @ turn))


@pytest.mark.parametrize("heading", [0.0, 1.1])
def test_poor_odometry_counts_for_what_it_is(heading):
    given = np.array([0.05, 0.03, 0.1])
    np.testing.assert_allclose(deviations(np.diag(given**2), heading), given, rtol=1e-3)


def test_odometry_better_than_the_map_counts_for_no_more_than_the_map():
    np.testing.assert_allclose(deviations(np.diag([1e-3, 2e-3, 1e-4]) ** 2), [0.02, 0.02, 0.01], rtol=1e-3)


def test_only_what_is_too_good_is_widened_and_correlations_stay():
    deviation, correlation = np.array([0.05, 0.002, 0.1]), 0.8
    covariance = np.diag(deviation**2)
    covariance[0, 1] = covariance[1, 0] = correlation * deviation[0] * deviation[1]
    np.testing.assert_allclose(deviations(covariance), [0.05, 0.02, 0.1], rtol=1e-2)


def test_trust_scales_the_precision():
    given = np.array([0.05, 0.03, 0.1])
    halved = PriorTrust(translation=0.25, rotation=4.0, least_translation=0.0, least_rotation=0.0)
    np.testing.assert_allclose(
        deviations(np.diag(given**2), trust=halved), given * [2.0, 2.0, 0.5], rtol=1e-3
    )


def test_negative_trust_is_refused():
    with pytest.raises(ValueError, match="least_rotation is -1"):
        PriorTrust(least_rotation=-1.0)
