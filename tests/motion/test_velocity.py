"""The velocity model against table 5.3 written out in NumPy, and its limits."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.motion import VelocityMotion
from tests.builders import odometry_of

ORIGIN = jnp.zeros(3, jnp.float32)


def arc(v, omega, gamma, dt, pose):
    """Equations (5.9) and (5.13) in float64, dividing by ω as printed."""
    x, y, theta = pose
    radius = v / omega
    return np.array(
        [
            x - radius * np.sin(theta) + radius * np.sin(theta + omega * dt),
            y + radius * np.cos(theta) - radius * np.cos(theta + omega * dt),
            theta + omega * dt + gamma * dt,
        ]
    )


@pytest.mark.parametrize("seed", range(5))
def test_a_step_is_table_5_3(seed):
    rng = np.random.default_rng(seed)
    alphas = rng.uniform(0.01, 0.1, 6)
    v, omega, dt = rng.uniform(-1.0, 1.0), rng.uniform(-1.5, 1.5), rng.uniform(0.1, 1.0)
    pose = np.array([*rng.uniform(-5.0, 5.0, 2), rng.uniform(-1.0, 1.0)])
    model = VelocityMotion(*(float(a) for a in alphas), 1e-6, 1e-6)
    key = jax.random.key(seed)
    turn, along, _, final = np.asarray(jax.random.normal(key, (4,), jnp.float32), np.float64)

    a1, a2, a3, a4, a5, a6 = alphas
    expected = arc(
        v + along * np.sqrt(a1 * v**2 + a2 * omega**2),
        omega + turn * np.sqrt(a3 * v**2 + a4 * omega**2),
        final * np.sqrt(a5 * v**2 + a6 * omega**2),
        dt,
        pose,
    )
    delta = arc(v, omega, 0.0, dt, np.zeros(3))
    drawn = np.asarray(model.sample(key, jnp.asarray(pose, jnp.float32), odometry_of(delta, dt=dt)))
    difference = drawn - expected
    difference[2] = (difference[2] + np.pi) % (2 * np.pi) - np.pi
    np.testing.assert_allclose(difference, 0.0, atol=2e-5)


def test_worked_example_of_the_docstring():
    deviation = np.sqrt(np.diagonal(VelocityMotion().covariance(odometry_of([1.0, 0.0, 0.0]))))
    np.testing.assert_allclose(deviation, [0.1001, 0.0503, 0.1226], atol=5e-5)


def test_the_straight_line_is_the_limit_of_arcs():
    model = VelocityMotion()
    angles = np.concatenate([[0.0], np.geomspace(1e-8, 1.5, 300)])
    # 1 m of arc; the chord by its series, whose next term is a⁶ / 322 560.
    chord = 1.0 - angles**2 / 24.0 + angles**4 / 1920.0
    deltas = np.stack([chord * np.cos(angles / 2), chord * np.sin(angles / 2), angles], axis=-1)

    def evaluate(delta):
        odometry = odometry_of(delta)
        return model.log_prob(delta, ORIGIN, odometry), model.covariance(odometry)

    log_probs, covariances = jax.jit(jax.vmap(evaluate))(jnp.asarray(deltas, jnp.float32))
    # Up to an angle of 1e-3 nothing differs from the straight line by more than that times order
    # one.
    tiny = angles <= 1e-3
    np.testing.assert_allclose(log_probs[tiny], log_probs[0], atol=2e-3)
    straight = np.broadcast_to(covariances[0], covariances[tiny].shape)
    np.testing.assert_allclose(covariances[tiny], straight, atol=2e-5)
    # And no jump anywhere, the switch from the series at 1 rad included (7 % more angle a point).
    assert np.abs(np.diff(log_probs)).max() < 0.1


def test_the_density_has_no_outliers_near_the_straight_line():
    # Heading errors that bring the expected arc within 1e-6 … 1e-2 rad of straight, where a second
    # derivative of sin(a)/a by cancellation would be noise.
    model, odometry = VelocityMotion(), odometry_of([0.5, 0.025, 0.1])
    headings = 0.1 + np.linspace(-0.31, 0.31, 20001)
    position = np.full((len(headings), 2), [0.5, 0.025])
    poses = jnp.asarray(np.concatenate([position, headings[:, None]], axis=-1), jnp.float32)
    log_prob = jax.jit(jax.vmap(model.log_prob, in_axes=(0, None, None)))
    values = np.asarray(log_prob(poses, ORIGIN, odometry))
    assert np.abs(np.diff(values)).max() < 0.02


@pytest.mark.parametrize("dt", [0.0, 1e-3, 7.0, float("nan")])
def test_the_duration_cancels(dt):
    model, delta = VelocityMotion(), [0.4, 0.1, 0.3]
    key = jax.random.key(4)
    reference = model.sample(key, ORIGIN, odometry_of(delta))
    np.testing.assert_array_equal(model.sample(key, ORIGIN, odometry_of(delta, dt=dt)), reference)
    np.testing.assert_array_equal(
        model.covariance(odometry_of(delta, dt=dt)), model.covariance(odometry_of(delta))
    )


@pytest.mark.parametrize("delta", [[0.5, 0.3, 0.2], [-0.3, 0.2, 3.1], [0.0, 0.4, -3.1], [0, 0, -3.14]])
def test_what_is_no_arc_is_kept(delta):
    model = VelocityMotion(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1e-9, 1e-9)
    drawn = model.sample(jax.random.key(0), ORIGIN, odometry_of(delta))
    np.testing.assert_allclose(drawn, delta, atol=2e-6)
