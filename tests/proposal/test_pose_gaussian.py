"""The Gaussian around a mode: moments, draws, densities, and what walls hold."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import multivariate_normal

from jaxslam.lidar.beams import ScanPoints
from jaxslam.proposal.pose_gaussian import PoseGaussian, PosesAround

FACTOR = np.array([[0.02, 0.0, 0.0], [0.01, 0.015, 0.0], [-0.002, 0.001, 0.004]])
COVARIANCE = FACTOR @ FACTOR.T
MODE = jnp.asarray([3.0, -2.0, 0.7], jnp.float32)
AROUND = PosesAround(spread=0.05, num_poses=4000)


def room(corridor=False) -> ScanPoints:
    """End points on the walls of a room of 6 × 4 m, or on the two long ones alone."""
    x, y = np.linspace(-3, 3, 31), np.linspace(-2, 2, 21)
    long = [np.stack([x, np.full_like(x, side)], axis=1) for side in (-2.0, 2.0)]
    short = [np.stack([np.full_like(y, side), y], axis=1) for side in (-3.0, 3.0)]
    parts = long if corridor else long + short
    normals = [np.tile([0.0, 1.0], (31, 1))] * 2 + [np.tile([1.0, 0.0], (21, 1))] * 2
    points = np.concatenate(parts).astype(np.float32)
    normals = np.concatenate(normals[: len(parts)]).astype(np.float32)
    return ScanPoints(jnp.asarray(points), jnp.ones(len(points), bool), jnp.asarray(normals))


@jax.jit
def fit_normal(around, key, mode, ends):
    precision = jnp.asarray(np.linalg.inv(COVARIANCE), jnp.float32)

    def log_value(pose):
        offset = pose - mode
        return -0.5 * offset @ (precision @ offset) + 5.0

    return around.fit(key, log_value, mode, ends)


def test_moments_of_a_normal_are_found():
    found = fit_normal(AROUND, jax.random.key(0), MODE, room())
    # Some 400 of the 4000 draws count: their mean is known to a twentieth of a standard deviation,
    # the deviations to a fifteenth, and the draws end at some three deviations.
    sigmas = np.sqrt(np.diag(COVARIANCE))
    assert np.abs((np.asarray(found.mean) - np.asarray(MODE)) / sigmas).max() < 0.2
    covariance = np.asarray(found.factor) @ np.asarray(found.factor).T
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), sigmas, rtol=0.25)
    correlation = covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1])
    assert correlation == pytest.approx(COVARIANCE[0, 1] / (sigmas[0] * sigmas[1]), abs=0.15)


def test_the_same_key_gives_the_same_bytes():
    one, same, other = (fit_normal(AROUND, jax.random.key(k), MODE, room()).mean for k in (1, 1, 2))
    assert one.tobytes() == same.tobytes()
    assert one.tobytes() != other.tobytes()


def test_density_and_draws_are_those_of_the_normal():
    gaussian = PoseGaussian(MODE, jnp.asarray(FACTOR, jnp.float32), jnp.float32(0.0))
    draws = np.asarray(jax.vmap(gaussian.sample)(jax.random.split(jax.random.key(3), 20_000)))
    np.testing.assert_allclose(draws.mean(axis=0), MODE, atol=5 * np.sqrt(np.diag(COVARIANCE) / 20_000).max())
    np.testing.assert_allclose(np.cov(draws.T), COVARIANCE, atol=0.03 * COVARIANCE.max())
    expected = multivariate_normal(np.asarray(MODE), COVARIANCE).logpdf(draws[:50])
    np.testing.assert_allclose(jax.vmap(gaussian.log_prob)(jnp.asarray(draws[:50])), expected, atol=2e-2)


def test_headings_wrap():
    mode = jnp.asarray([0.0, 0.0, np.pi - 1e-3], jnp.float32)
    found = fit_normal(AROUND, jax.random.key(4), mode, room())
    draws = np.asarray(jax.vmap(found.sample)(jax.random.split(jax.random.key(5), 200)))
    assert np.abs(draws[:, 2]).min() > 3.0
    assert (draws[:, 2] < 0).any()
    assert (draws[:, 2] > 0).any()
    other_side = jnp.asarray([0.0, 0.0, -np.pi + 1e-3], jnp.float32)
    assert float(found.log_prob(other_side)) == pytest.approx(float(found.log_prob(mode)), abs=2.0)


@jax.jit
def fit_flat(around, key, ends, value):
    return around.fit(key, lambda pose: value, jnp.zeros(3, jnp.float32), ends)


def test_the_cloud_is_long_along_a_corridor():
    around = PosesAround(spread=0.03, reach_translation=0.3)
    closed, corridor = (
        np.abs(np.asarray(fit_flat(around, jax.random.key(6), room(open_ends), jnp.float32(0.0)).factor))
        for open_ends in (False, True)
    )
    # Uniform within ±reach: a standard deviation of reach / √3.
    assert corridor[0, 0] == pytest.approx(0.3 / np.sqrt(3), rel=0.15)
    assert closed[0, 0] < 0.05
    assert corridor[1, 1] < 0.03


def test_eta_is_the_mean_of_the_values():
    found = fit_flat(AROUND, jax.random.key(7), room(), jnp.float32(-12.5))
    assert float(found.log_eta) == pytest.approx(-12.5, abs=1e-4)


@pytest.mark.parametrize("value", [jnp.nan, -jnp.inf])
def test_values_that_say_nothing_leave_the_cloud_as_it_was_drawn(value):
    found = fit_flat(AROUND, jax.random.key(8), room(), jnp.float32(value))
    assert np.abs(np.asarray(found.mean)).max() < 0.01
    assert np.isfinite(found.factor).all()
    assert float(found.log_eta) == -np.inf


def test_a_scan_without_walls_reaches_as_far_as_allowed():
    blind = ScanPoints(jnp.zeros((9, 2)), jnp.zeros(9, bool), jnp.zeros((9, 2)))
    found = fit_flat(PosesAround(num_poses=4000), jax.random.key(9), blind, jnp.float32(0.0))
    expected = np.array([0.2, 0.2, 0.05]) / np.sqrt(3)
    np.testing.assert_allclose(np.diagonal(found.factor), expected, rtol=0.05)


def test_impossible_reaches_are_refused():
    with pytest.raises(ValueError, match="spread is 0"):
        PosesAround(spread=0.0)
