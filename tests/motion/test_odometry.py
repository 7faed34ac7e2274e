"""The odometry model against table 5.6 written out in NumPy, and its departures from it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.core import se2
from jaxslam.motion import OdometryMotion
from tests.builders import odometry_of

ORIGIN = jnp.zeros(3, jnp.float32)


def table_5_6(alphas, delta, pose, normals):
    """One draw in float64, as printed, given its three standard normals."""
    x, y, theta = delta
    rotation_1, translation = np.arctan2(y, x), np.hypot(x, y)
    rotation_2 = theta - rotation_1
    a1, a2, a3, a4 = alphas
    rotation_1_hat = rotation_1 + normals[0] * np.sqrt(a1 * rotation_1**2 + a2 * translation**2)
    translation_hat = translation + normals[1] * np.sqrt(
        a3 * translation**2 + a4 * (rotation_1**2 + rotation_2**2)
    )
    rotation_2_hat = rotation_2 + normals[2] * np.sqrt(a1 * rotation_2**2 + a2 * translation**2)
    direction = pose[2] + rotation_1_hat
    return np.array(
        [
            pose[0] + translation_hat * np.cos(direction),
            pose[1] + translation_hat * np.sin(direction),
            direction + rotation_2_hat,
        ]
    )


@pytest.mark.parametrize("seed", range(5))
def test_a_forward_step_is_table_5_6(seed):
    rng = np.random.default_rng(seed)
    alphas = rng.uniform(0.01, 0.3, 4)
    delta = np.array([rng.uniform(0.2, 1.0), rng.uniform(-0.5, 0.5), rng.uniform(-1.0, 1.0)])
    pose = np.array([*rng.uniform(-5.0, 5.0, 2), rng.uniform(-1.0, 1.0)])
    # Floors and threshold so small that they add less than the tolerance.
    model = OdometryMotion(*(float(a) for a in alphas), 1e-6, 1e-6, 1e-5)
    key = jax.random.key(seed)
    turn, along, _, final = np.asarray(jax.random.normal(key, (4,), jnp.float32), np.float64)
    expected = table_5_6(alphas, delta, pose, (turn, along, final))
    drawn = np.asarray(model.sample(key, jnp.asarray(pose, jnp.float32), odometry_of(delta)))
    difference = drawn - expected
    difference[2] = (difference[2] + np.pi) % (2 * np.pi) - np.pi
    # Rounding of positions of about 5 m: 5e-7 each; floors: 5 deviations of 1e-6.
    np.testing.assert_allclose(difference, 0.0, atol=2e-5)


def test_worked_example_of_the_docstring():
    model = OdometryMotion(0.02, 0.01, 0.01, 0.0025, 0.005, 0.005)
    deviation = np.sqrt(np.diagonal(model.covariance(odometry_of([1.0, 0.0, 0.0]))))
    np.testing.assert_allclose(deviation, [0.1001, 0.1002, 0.1415], atol=5e-5)


def test_covariance_by_hand():
    # 2 m straight, then a quarter turn: rot1 = 0, rot2 = π/2 ≈ 1.5708, and the predicted frame is
    # turned by π/2, so what was along is −y and what was across is +x. Floors and threshold vanish.
    #   rot1: 0.01 · 4 = 0.04, rot2: 0.1 · 2.4674 + 0.04 = 0.28674
    #   trans: 0.02 · 4 + 0.05 · 2.4674 = 0.20337
    #   across: 4 · 0.04 = 0.16; across with heading: 2 · 0.04 = 0.08; heading: 0.32674
    model = OdometryMotion(0.1, 0.01, 0.02, 0.05, 1e-6, 1e-6, 1e-5)
    covariance = model.covariance(odometry_of([2.0, 0.0, np.pi / 2]))
    expected = [[0.16, 0.0, 0.08], [0.0, 0.20337, 0.0], [0.08, 0.0, 0.32674]]
    np.testing.assert_allclose(covariance, expected, atol=2e-5)


@pytest.mark.parametrize("bend", [0.0, 0.2, -0.4])
def test_reversing_is_as_certain_as_driving_forward(bend):
    # An arc driven forward and the same arc driven backward: the mirror image, with equal noise.
    forward = np.array([0.5 * np.cos(bend / 2), 0.5 * np.sin(bend / 2), bend])
    backward = np.array([-forward[0], forward[1], -forward[2]])
    model = OdometryMotion()
    mirror = np.diag([-1.0, 1.0, -1.0])
    np.testing.assert_allclose(
        model.covariance(odometry_of(backward)),
        mirror @ np.asarray(model.covariance(odometry_of(forward))) @ mirror,
        atol=1e-7,
    )


def test_turning_in_place_is_one_rotation_whatever_the_jitter():
    # Variance α1 θ² + floor², no translation: 0.02 · 1² + 0.005² = 0.020025.
    model = OdometryMotion(0.02, 0.01, 0.01, 0.0025, 0.005, 0.005)
    still = model.covariance(odometry_of([0.0, 0.0, 1.0]))
    assert float(still[2, 2]) == pytest.approx(0.020025, rel=1e-5)
    # Jitter of 0.1 mm in any direction changes that by less than a hundredth of its deviation: the
    # first rotation is at most 1e-4 / 0.01 = 0.01 rad, and 2 θ · 0.01 · α1 = 4e-4 at first order.
    for angle in np.linspace(-np.pi, np.pi, 16):
        jitter = odometry_of([1e-4 * np.cos(angle), 1e-4 * np.sin(angle), 1.0])
        np.testing.assert_allclose(model.covariance(jitter), still, atol=4.1e-4)


def test_density_is_continuous_through_the_direction_threshold():
    model = OdometryMotion()
    lengths = np.geomspace(1e-5, 0.1, 400)
    deltas = jnp.asarray(np.stack([lengths, 0.5 * lengths, 0.3 + 0 * lengths], axis=-1), jnp.float32)

    def at_mean(delta):
        return model.log_prob(delta, ORIGIN, odometry_of(delta))

    values = np.asarray(jax.jit(jax.vmap(at_mean))(deltas))
    assert np.ptp(values) > 0.5
    # The grid grows by 2.3 % a point; the log-density moves by less than that times its few
    # logarithms.
    assert np.abs(np.diff(values)).max() < 0.05


@pytest.mark.parametrize("delta", [[0.5, 0.1, 0.2], [-0.3, 0.2, 3.0], [0.0, 0.4, -3.0], [1e-3, 0, 1]])
def test_without_noise_the_sample_is_the_increment(delta):
    model = OdometryMotion(0.0, 0.0, 0.0, 0.0, 1e-9, 1e-9, 0.01)
    pose = jnp.array([1.0, 2.0, 3.0], jnp.float32)
    odometry = odometry_of(delta)
    expected = se2.compose(pose, odometry.delta)
    error = se2.relative(expected, model.sample(jax.random.key(0), pose, odometry))
    np.testing.assert_allclose(error, 0.0, atol=2e-6)
