"""The IMU: exact without errors; white noise, bias and walk have the given size."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.core import se2
from jaxslam.sim import Imu, Robot, hall_small
from jaxslam.sim.robot import Drive, follow_tour
from jaxslam.sim.simulate import sample_times

SILENT = Imu(
    rate_noise_density=0.0,
    sigma_rate_bias=0.0,
    rate_bias_walk=0.0,
    sigma_heading=0.0,
    sigma_heading_bias=0.0,
    heading_bias_walk=0.0,
)
TIMES = sample_times(100.0, 100.0, phase=0.5)


@jax.jit
def run(imu: Imu, key, motion: Drive):
    return imu.simulate(key, motion, TIMES)


def standing() -> Drive:
    poses = jnp.tile(jnp.array([1.0, 2.0, 0.7]), (10_001, 1))
    return Drive(
        poses=poses,
        velocities=jnp.zeros_like(poses),
        targets=jnp.zeros(10_001, jnp.int32),
        rate=100.0,
    )


def test_without_errors_it_tells_the_truth() -> None:
    _, tour = hall_small()
    motion = follow_tour(Robot(), jnp.asarray(tour, jnp.float32), 10_000)
    inertial = run(SILENT, jax.random.key(0), motion)
    poses, velocities = motion.at(TIMES)
    np.testing.assert_array_equal(inertial.yaw_rates, velocities[:, 2])
    turned = np.asarray(se2.wrap(poses[:, 2] - motion.poses[0, 2]))
    np.testing.assert_allclose(inertial.headings, turned, atol=1e-6)
    # The rate integrates to the heading, so that the two sensors agree with each other.
    integrated = np.cumsum(np.asarray(inertial.yaw_rates, np.float64)) / 100
    gap = np.asarray(se2.wrap(jnp.asarray(integrated - turned, jnp.float32)))
    # Half a sample at full rate, and rounding of 1e4 float32 headings.
    assert np.abs(gap).max() < 0.5 / 100 + 2e-3


def test_white_noise() -> None:
    imu = Imu(sigma_rate_bias=0.0, rate_bias_walk=0.0, heading_bias_walk=0.0)
    inertial = run(imu, jax.random.key(3), standing())
    # 10 000 samples: four standard errors of a standard deviation are 4/√20 000 = 2.8 %.
    assert np.std(inertial.yaw_rates) == pytest.approx(2e-4 * 10, rel=0.028)
    assert np.std(inertial.headings) == pytest.approx(0.01, rel=0.028)
    assert np.mean(inertial.headings) == pytest.approx(0.0, abs=4 * 0.01 / 100)
    np.testing.assert_array_equal(inertial.rate_biases, 0)


def test_biases_start_and_walk_as_they_should() -> None:
    imu = Imu(sigma_rate_bias=0.01, rate_bias_walk=0.002, heading_bias_walk=0.005)
    motion, times = standing(), sample_times(100.0, 9.0, phase=0.5)
    keys = jax.random.split(jax.random.key(4), 1000)

    def biases(key):
        inertial = imu.simulate(key, motion, times)
        return inertial.rate_biases[jnp.array([0, -1])], inertial.heading_biases[-1]

    rate, heading = jax.jit(jax.vmap(biases))(keys)
    # 1000 samples: four standard errors are 4/√2000 = 9 %. The walk lasts 8.99 s.
    assert np.std(rate[:, 0]) == pytest.approx(0.01, rel=0.09)
    assert np.std(rate[:, 1] - rate[:, 0]) == pytest.approx(0.002 * 3, rel=0.09)
    assert np.std(heading) == pytest.approx(0.005 * 3, rel=0.09)


def test_a_rate_that_is_not_positive_is_refused() -> None:
    with pytest.raises(ValueError, match="rate is 0"):
        Imu(rate=0.0)
