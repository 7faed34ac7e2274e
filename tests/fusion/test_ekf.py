"""The Kalman filter against a textbook one, and its consistency over simulated drives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import chi2

from jaxslam.fusion import EKF, Belief, Measurement
from jaxslam.fusion.ekf import since_copy, with_copy


@pytest.fixture(scope="module", autouse=True)
def double_precision():
    """The textbook comparison needs 1e-9."""
    with jax.enable_x64(True):
        yield


def measurement(value, variance, seen) -> Measurement:
    return Measurement(
        jnp.asarray(value, jnp.float64), jnp.asarray(variance, jnp.float64), jnp.asarray(seen, bool)
    )


def textbook(mean, covariance, dt, ekf, value, variance, seen):
    """Predict and update of the linear form, in NumPy, with explicit H and inverse."""
    transition = np.eye(6)
    transition[:3, 3:] = dt * np.eye(3)
    q = np.diag([ekf.acceleration**2, ekf.acceleration**2, ekf.angular_acceleration**2])
    noise = np.block([[q * dt**3 / 3, q * dt**2 / 2], [q * dt**2 / 2, q * dt]])
    mean = transition @ mean
    covariance = transition @ covariance @ transition.T + noise
    rows = np.flatnonzero(seen)
    h = np.eye(6)[rows]
    s = h @ covariance @ h.T + np.diag(np.asarray(variance)[rows])
    gain = covariance @ h.T @ np.linalg.inv(s)
    mean = mean + gain @ (np.asarray(value)[rows] - h @ mean)
    return mean, (np.eye(6) - gain @ h) @ covariance


def test_the_linear_form_is_a_textbook_kalman_filter():
    ekf = EKF(frame="world", gate=False)
    random = np.random.default_rng(0)
    mean, covariance = np.zeros(6), np.diag([0.1, 0.1, 0.05, 1.0, 1.0, 0.5])
    belief = Belief(jnp.asarray(mean), jnp.asarray(covariance))
    step = jax.jit(lambda b, dt, m: ekf.update(ekf.predict(b, dt), m).belief)
    for _ in range(50):
        dt, value = random.uniform(0.01, 0.2), 0.3 * random.normal(size=6)
        variance, seen = random.uniform(0.01, 0.3, 6), random.random(6) < 0.6
        mean, covariance = textbook(mean, covariance, dt, ekf, value, variance, seen)
        belief = step(belief, jnp.float64(dt), measurement(value, variance, seen))
        np.testing.assert_allclose(belief.mean, mean, atol=1e-9)
        np.testing.assert_allclose(belief.covariance, covariance, atol=1e-9)


def test_the_jacobian_of_the_body_frame_is_the_derivative():
    ekf = EKF()
    mean = jnp.asarray([0.3, -0.2, 0.7, 0.5, 0.1, -0.4])
    _, transition = ekf._transition(mean, jnp.float64(0.2))
    derivative = jax.jacfwd(lambda x: ekf._transition(x, jnp.float64(0.2))[0])(mean)
    np.testing.assert_allclose(transition, derivative, atol=1e-12)


def test_the_covariance_stays_symmetric_and_positive():
    ekf = EKF()
    belief = Belief(jnp.zeros(6), jnp.diag(jnp.asarray([1e-6, 1e-6, 1e-6, 1.0, 1.0, 1.0])))
    step = jax.jit(lambda b, m: ekf.update(ekf.predict(b, jnp.float64(0.05)), m).belief)
    for index in range(300):
        seen = [False, False, False, True, True, True] if index % 2 else [False] * 5 + [True]
        belief = step(belief, measurement([0, 0, 0, 0.5, 0, 0.3], [1e-6] * 6, seen))
    covariance = np.asarray(belief.covariance)
    np.testing.assert_array_equal(covariance, covariance.T)
    assert np.linalg.eigvalsh(covariance).min() > 0


@pytest.mark.parametrize("frame", ["body", "world"])
def test_the_normalized_error_is_that_of_chi_square(frame):
    """NEES over 100 drives whose motion and readings are drawn from the filter's own model."""
    ekf = EKF(acceleration=0.3, lateral_acceleration=0.3, angular_acceleration=0.3, gate=False, frame=frame)
    dt, steps, runs = 0.05, 60, 100
    variance = np.array([1.0, 1.0, 1.0, 0.01, 0.01, 0.001])
    seen = [False, False, False, True, True, True]

    def drive(key):
        start = Belief(jnp.zeros(6), jnp.diag(jnp.asarray([1e-4, 1e-4, 1e-4, 0.04, 0.04, 0.01])))
        key_start, key_steps = jax.random.split(key)
        truth = jnp.sqrt(jnp.diagonal(start.covariance)) * jax.random.normal(key_start, (6,), jnp.float64)

        def step(carry, key):
            truth, belief = carry
            key_move, key_read = jax.random.split(key)
            noise = ekf._process_noise(truth, jnp.float64(dt)) + 1e-15 * jnp.eye(6)
            shock = jnp.linalg.cholesky(noise) @ jax.random.normal(key_move, (6,), jnp.float64)
            truth = ekf._transition(truth, jnp.float64(dt))[0] + shock
            value = truth + jnp.sqrt(variance) * jax.random.normal(key_read, (6,), jnp.float64)
            belief = ekf.predict(belief, jnp.float64(dt))
            return (truth, ekf.update(belief, measurement(value, variance, seen)).belief), None

        (truth, belief), _ = jax.lax.scan(step, (truth, start), jax.random.split(key_steps, steps))
        error = truth - belief.mean
        error = error.at[2].set(jnp.mod(error[2] + jnp.pi, 2 * jnp.pi) - jnp.pi)
        return error @ jnp.linalg.solve(belief.covariance, error)

    errors = np.asarray(jax.jit(jax.vmap(drive))(jax.random.split(jax.random.key(0), runs)))
    low, high = chi2.ppf([0.025, 0.975], 6 * runs) / runs
    assert low < errors.mean() < high


def test_headings_are_compared_round_the_circle():
    ekf = EKF(gate=False)
    belief = Belief(jnp.zeros(6).at[2].set(np.pi - 0.01), jnp.eye(6))
    seen = [False, False, True, False, False, False]
    updated = ekf.update(belief, measurement([0, 0, -np.pi + 0.01, 0, 0, 0], [1.0] * 6, seen))
    # Half way, 0.01 on, through ±π.
    assert float(jnp.mod(updated.belief.mean[2], 2 * jnp.pi)) == pytest.approx(np.pi, abs=1e-6)


def test_an_outlier_is_refused_and_changes_nothing():
    belief = Belief(jnp.zeros(6), 0.01 * jnp.eye(6))
    seen = [False] * 5 + [True]
    wild = measurement([0, 0, 0, 0, 0, 143.0], [0.01] * 6, seen)
    refused, used = EKF().update(belief, wild), EKF(gate=False).update(belief, wild)
    assert not refused.accepted
    np.testing.assert_array_equal(refused.belief.mean, belief.mean)
    np.testing.assert_array_equal(refused.belief.covariance, belief.covariance)
    assert used.accepted
    assert float(refused.distance) == pytest.approx(143.0**2 / 0.02)


def test_nothing_read_changes_nothing():
    belief = Belief(jnp.arange(6.0) / 10, 0.01 * jnp.eye(6))
    updated = EKF().update(belief, measurement([9.0] * 6, [1.0] * 6, [False] * 6))
    np.testing.assert_allclose(updated.belief.mean, belief.mean, atol=1e-15)
    np.testing.assert_allclose(updated.belief.covariance, belief.covariance, atol=1e-15)


def test_the_motion_since_a_copy_has_the_covariance_of_its_samples():
    random = np.random.default_rng(2)
    start = Belief(jnp.asarray([1.0, 2.0, 0.8, 0.5, 0.0, 0.3]), 1e-4 * jnp.eye(6))
    moved = EKF().predict(with_copy(start), jnp.float64(0.4))
    delta, covariance = since_copy(moved)
    samples = random.multivariate_normal(np.asarray(moved.mean), np.asarray(moved.covariance), 20000)
    cos, sin = np.cos(samples[:, 8]), np.sin(samples[:, 8])
    difference = samples[:, :2] - samples[:, 6:8]
    along = cos * difference[:, 0] + sin * difference[:, 1]
    across = -sin * difference[:, 0] + cos * difference[:, 1]
    seen = np.cov(np.stack([along, across, samples[:, 2] - samples[:, 8]]))
    # The relative standard error of a variance from 20000 samples is 1 %.
    np.testing.assert_allclose(np.diag(covariance), np.diag(seen), rtol=0.06)
    np.testing.assert_allclose(delta, [0.2, 0.0, 0.12], atol=0.02)
