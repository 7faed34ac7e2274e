"""The Gaussian model against scipy."""

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats

from jaxslam.core import se2
from jaxslam.motion import GaussianMotion
from tests.builders import odometry_of

COVARIANCE = np.array([[4e-3, 1e-3, 2e-3], [1e-3, 2e-3, -1e-3], [2e-3, -1e-3, 5e-3]])
ORIGIN = jnp.zeros(3, jnp.float32)


def test_log_prob_is_the_normal_density():
    model, delta = GaussianMotion(2.0, 0.01, 0.02), np.array([0.4, -0.1, 0.3])
    total = 2.0 * COVARIANCE + np.diag([0.01, 0.01, 0.02]) ** 2
    poses = np.random.default_rng(0).multivariate_normal(delta, total, 20)
    log_prob = jax.jit(jax.vmap(model.log_prob, in_axes=(0, None, None)))
    found = log_prob(jnp.asarray(poses, jnp.float32), ORIGIN, odometry_of(delta, COVARIANCE))
    expected = scipy.stats.multivariate_normal(delta, total).logpdf(poses)
    np.testing.assert_allclose(found, expected, atol=1e-3)


def test_worked_example_of_the_docstring():
    model = GaussianMotion(1.0, 0.01, 0.005)
    odometry = odometry_of([0.0, 0.0, 0.0], np.zeros((3, 3)))
    np.testing.assert_allclose(
        model.covariance(odometry), np.diag([1e-4, 1e-4, 2.5e-5]), rtol=1e-5, atol=1e-12
    )
    # −1.5 log 2π − ½ log(1e-4 · 1e-4 · 2.5e-5) = −2.7568 + 14.5087
    assert float(model.log_prob(ORIGIN, ORIGIN, odometry)) == pytest.approx(11.752, abs=1e-3)


def test_covariance_is_turned_into_the_predicted_frame():
    # A quarter turn: the new x axis is the old y, the new y the old −x. Floors: 1e-6 on the
    # diagonal.
    model = GaussianMotion(1.0, 0.001, 0.001)
    covariance = model.covariance(odometry_of([0.3, 0.0, np.pi / 2], COVARIANCE))
    expected = [[2e-3, -1e-3, -1e-3], [-1e-3, 4e-3, -2e-3], [-1e-3, -2e-3, 5e-3]]
    np.testing.assert_allclose(covariance, np.add(expected, 1e-6 * np.eye(3)), atol=1e-8)


def test_the_heading_error_is_wrapped():
    odometry = odometry_of([0.0, 0.0, 3.1], np.zeros((3, 3)))
    ahead = jnp.array([0.0, 0.0, -3.1], jnp.float32)
    model = GaussianMotion(1.0, 0.1, 0.1)
    peak = model.log_prob(jnp.array([0.0, 0.0, 3.1], jnp.float32), ORIGIN, odometry)
    # 2π − 6.2 = 0.08319 rad on, not 6.2 rad off.
    drop = float(peak - model.log_prob(ahead, ORIGIN, odometry))
    assert drop == pytest.approx(0.5 * (0.08319 / 0.1) ** 2, rel=1e-3)


@pytest.mark.parametrize(
    "covariance",
    [
        -np.eye(3),
        np.array([[1e-4, 1.0, 0.0], [1.0, 1e-4, 0.0], [0.0, 0.0, 1e-4]]),
        np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]),
    ],
)
def test_an_indefinite_covariance_is_repaired(covariance):
    model, odometry = GaussianMotion(), odometry_of([0.1, 0.0, 0.2], covariance)
    pose_next = model.sample(jax.random.key(0), ORIGIN, odometry)
    chex.assert_tree_all_finite((pose_next, model.log_prob(pose_next, ORIGIN, odometry)))
    repaired = np.asarray(model.covariance(odometry), np.float64)
    assert np.linalg.eigvalsh(repaired).min() > 0.0
    # Turning the frame keeps the sum of the variances: what came in, and at most two floors an
    # axis.
    allowed = np.maximum(np.diag(covariance), 0.0).sum() + 6 * 0.005**2
    assert np.trace(repaired) <= allowed * (1.0 + 1e-5)


def test_sampling_at_a_pose_turns_the_noise_with_it():
    # Noise along the base's x only: seen from a pose heading along +y, it is along the world's y.
    covariance = np.diag([0.04, 0.0, 0.0])
    model = GaussianMotion(1.0, 1e-6, 1e-6)
    pose = jnp.array([0.0, 0.0, np.pi / 2], jnp.float32)
    keys = jax.random.split(jax.random.key(0), 1000)
    sample = jax.jit(jax.vmap(model.sample, in_axes=(0, None, None)))
    poses = np.asarray(sample(keys, pose, odometry_of([0.5, 0.0, 0.0], covariance)))
    # Deviation of a deviation over 1000 samples: 0.2 / √2000 = 0.0045; five of them.
    assert poses[:, 1].std() == pytest.approx(0.2, abs=0.0225)
    assert np.abs(poses[:, 0]).max() < 1e-4
    np.testing.assert_allclose(se2.wrap(jnp.asarray(poses[:, 2] - np.pi / 2)), 0.0, atol=1e-5)
