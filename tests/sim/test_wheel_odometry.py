"""Wheel odometry: exact without errors, closed forms for each error, statistics, drift."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.core import se2
from jaxslam.sim import Robot, WheelOdometry, hall_small
from jaxslam.sim.robot import Drive, advance, follow_tour
from jaxslam.sim.simulate import sample_times

PERFECT = WheelOdometry(sigma_radius_error=0.0, sigma_track_width_error=0.0, sigma_slip=0.0)


def steady(speed: float, yaw_rate: float) -> Drive:
    """Ten seconds at constant velocity from the origin, 100 steps per second."""
    num_steps = 1000
    velocity = jnp.array([speed, 0.0, yaw_rate])
    times = jnp.arange(num_steps + 1, dtype=jnp.float32) / 100
    poses = jax.vmap(lambda time: advance(jnp.zeros(3), velocity, time))(times)
    return Drive(
        poses=poses,
        velocities=jnp.tile(velocity, (num_steps + 1, 1)),
        targets=jnp.zeros(num_steps + 1, jnp.int32),
        rate=100.0,
    )


@jax.jit
def run(wheels: WheelOdometry, motion: Drive):
    duration = (motion.poses.shape[0] - 1) / motion.rate
    times = sample_times(wheels.rate, duration, phase=0.0)
    return wheels.simulate(jax.random.key(0), motion, times)


def test_without_errors_it_follows_the_true_drive() -> None:
    _, tour = hall_small()
    motion = follow_tour(Robot(), jnp.asarray(tour, jnp.float32), 10_000)
    odometry = run(PERFECT, motion)
    true = se2.relative(jnp.broadcast_to(motion.poses[0], (5001, 3)), motion.poses[::2])
    error = np.asarray(odometry.poses - true)
    # One tick is 0.31 mm: the heading is off by at most one tick over the track, 0.8 mrad, which is
    # up to 1.5 cm over the 20 m across the hall, as it does not build up.
    assert np.abs(np.asarray(se2.wrap(jnp.asarray(error[:, 2])))).max() < 1e-3
    assert np.abs(error[:, :2]).max() < 0.02


def test_ticks_by_hand() -> None:
    # Straight at 1 m/s: one turn of the wheel is 2π·0.1 m, so 2048/(0.2π) = 3259.5 ticks per meter.
    odometry = run(PERFECT, steady(1.0, 0.0))
    np.testing.assert_array_equal(odometry.ticks[50], [3259, 3259])
    np.testing.assert_array_equal(odometry.ticks[0], [0, 0])
    assert odometry.wheel_angles[50, 0] == pytest.approx(3259 / 2048 * 2 * np.pi, rel=1e-6)
    # On the spot at 1 rad/s the left wheel rolls back 0.2 m in 1 s, rounded down to −652 ticks.
    np.testing.assert_array_equal(run(PERFECT, steady(0.0, 1.0)).ticks[50], [-652, 651])


def test_integration_is_exact_on_an_arc() -> None:
    turn_by_tick = 2 * np.pi * 0.1 / 2048 / 0.4
    ticks = jnp.array([[0, 0], [1000, 3000], [3000, 3000]], jnp.int32)
    poses, deltas = PERFECT.integrate(ticks)
    turn, length = 2000 * turn_by_tick, 2000 * 2 * np.pi * 0.1 / 2048
    radius = length / turn
    arc_end = [radius * np.sin(turn), radius * (1 - np.cos(turn)), turn]
    np.testing.assert_allclose(poses[0], 0, atol=1e-7)
    np.testing.assert_allclose(poses[1], arc_end, rtol=1e-5)
    np.testing.assert_allclose(deltas[1], [length, 0, turn], rtol=1e-5)
    # Then the left wheel catches up: the same arc the other way round, back to heading 0.
    assert poses[2, 2] == pytest.approx(0.0, abs=1e-6)
    assert deltas[2, 2] == pytest.approx(-turn, rel=1e-5)


def test_larger_wheels_report_less_way() -> None:
    wheels = WheelOdometry(
        left_radius_error=0.02,
        right_radius_error=0.02,
        sigma_radius_error=0.0,
        sigma_track_width_error=0.0,
        sigma_slip=0.0,
    )
    poses = run(wheels, steady(1.0, 0.0)).poses
    np.testing.assert_allclose(poses[-1], [10 / 1.02, 0, 0], atol=1e-3)


def test_unequal_wheels_bend_a_straight_line() -> None:
    # The right wheel is 1 % larger, so it turns 1/1.01 as far: (10/1.01 − 10)/0.4 rad.
    wheels = WheelOdometry(
        right_radius_error=0.01,
        sigma_radius_error=0.0,
        sigma_track_width_error=0.0,
        sigma_slip=0.0,
    )
    poses = run(wheels, steady(1.0, 0.0)).poses
    assert poses[-1, 2] == pytest.approx((10 / 1.01 - 10) / 0.4, abs=2e-3)


def test_wider_track_exaggerates_turns() -> None:
    wheels = WheelOdometry(
        track_width_error=0.05,
        sigma_radius_error=0.0,
        sigma_track_width_error=0.0,
        sigma_slip=0.0,
    )
    poses = run(wheels, steady(0.0, 1.0)).poses
    assert poses[100, 2] == pytest.approx(2.0 * 1.05, abs=2e-3)


def test_slip_grows_with_the_square_root_of_the_way() -> None:
    wheels = WheelOdometry(sigma_radius_error=0.0, sigma_track_width_error=0.0, sigma_slip=0.01)
    motion = steady(1.0, 0.0)
    times = sample_times(wheels.rate, 10.0, phase=0.0)
    keys = jax.random.split(jax.random.key(1), 2000)
    final = jax.vmap(lambda key: wheels.simulate(key, motion, times).poses[-1])
    poses = jax.jit(final)(keys)
    # Each wheel 0.01·√10 m, their difference √2 times that, over the track. The standard error of a
    # standard deviation from n samples is 1/√(2n) = 1.6 %; four of them, and 0.2 % for the ticks.
    expected = 2**0.5 * 0.01 * 10**0.5 / 0.4
    assert np.std(poses[:, 2]) == pytest.approx(expected, rel=0.066)
    assert np.mean(poses[:, 2]) == pytest.approx(0.0, abs=4 * expected / 2000**0.5 + 8e-4)


def test_systematic_errors_have_the_given_spread() -> None:
    wheels = WheelOdometry(track_width_error=0.03)
    noise = jax.random.normal(jax.random.key(2), (4000, 3))
    errors = jax.vmap(wheels.errors)(noise)
    # Four standard errors: 4/√(2·4000) = 4.5 % of a standard deviation, 4·0.01/√4000 of the mean.
    assert np.std(errors.left_radius) == pytest.approx(0.001, rel=0.045)
    assert np.std(errors.right_radius) == pytest.approx(0.001, rel=0.045)
    assert np.std(errors.track_width) == pytest.approx(0.01, rel=0.045)
    assert np.mean(errors.track_width) == pytest.approx(0.03, abs=6.4e-4)


def test_default_drift_over_100_meters_is_what_the_docstring_says() -> None:
    _, tour = hall_small()
    motion = follow_tour(Robot(), jnp.asarray(tour, jnp.float32), 13_000)
    step = int(np.searchsorted(np.cumsum(motion.velocities[:, 0]) / 100, 100.0)) // 2 * 2
    times = sample_times(50.0, 130.0, phase=0.0)
    keys = jax.random.split(jax.random.key(0), 200)
    wheels = WheelOdometry()
    final = jax.vmap(lambda key: wheels.simulate(key, motion, times).poses[step // 2])
    poses = jax.jit(final)(keys)
    error = poses - se2.relative(motion.poses[0], motion.poses[step])[None]
    heading = np.degrees(np.sqrt(np.mean(np.asarray(se2.wrap(error[:, 2])) ** 2)))
    position = np.sqrt(np.mean(np.sum(np.asarray(error[:, :2]) ** 2, axis=1)))
    # Closed form of the heading: unequal wheels 100·0.001·√2/0.4 rad, slip √(2·100)·0.004/0.4 rad,
    # and the track's 1 % of the net turn (under two turns: 7°). 20 % is four standard errors.
    expected = np.degrees(np.hypot(100 * 0.001 * 2**0.5 / 0.4, (2 * 100) ** 0.5 * 0.004 / 0.4))
    assert heading == pytest.approx(expected, rel=0.2)
    # No closed form: within four standard errors (20 %) of the documented 2.9 m.
    assert position == pytest.approx(2.9, rel=0.2)


def test_twists_average_the_velocity() -> None:
    twists = np.asarray(run(PERFECT, steady(0.5, 0.3)).twists)[1:]
    # Ticks come in whole numbers, 0.31 mm per reading of 20 ms, but the mean has them all.
    assert twists[:, 0].mean() == pytest.approx(0.5, abs=1e-3)
    assert twists[:, 2].mean() == pytest.approx(0.3, abs=1e-3)
    np.testing.assert_array_equal(twists[:, 1], 0)


def test_a_rate_that_is_not_positive_is_refused() -> None:
    with pytest.raises(ValueError, match="rate is -1"):
        WheelOdometry(rate=-1.0)
