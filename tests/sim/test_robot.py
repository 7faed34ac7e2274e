"""The true drive: exact arcs, limits, clearance, way-points."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.sim import Robot, hall_large, hall_small, random_hall
from jaxslam.sim.robot import Drive, advance, follow_tour

NUM_STEPS = 20_000  # 200 s


def drive_in(builder) -> tuple[np.ndarray, np.ndarray, Drive]:
    world, tour = builder()
    return (
        np.asarray(world.segments, np.float64),
        tour,
        follow_tour(Robot(), jnp.asarray(tour, jnp.float32), NUM_STEPS),
    )


BUILDERS = [hall_small, hall_large, lambda: random_hall(jax.random.key(7))]


@pytest.fixture(scope="module", params=range(3), ids=["small", "large", "random"])
def driven(request) -> tuple[np.ndarray, np.ndarray, Drive]:
    return drive_in(BUILDERS[request.param])


def test_advance_is_an_exact_arc() -> None:
    moved = advance(jnp.zeros(3), jnp.array([1.0, 0.0, math.pi / 2]), 1.0)
    np.testing.assert_allclose(moved, [2 / math.pi, 2 / math.pi, math.pi / 2], rtol=1e-6)
    straight = advance(jnp.array([1.0, 2.0, math.pi / 2]), jnp.array([2.0, 0.0, 0.0]), 0.5)
    np.testing.assert_allclose(straight, [1.0, 3.0, math.pi / 2], rtol=1e-6)


def test_speed_and_acceleration_stay_within_the_limits(driven) -> None:
    robot, velocities = Robot(), np.asarray(driven[2].velocities, np.float64)
    speed, yaw_rate = velocities[:, 0], velocities[:, 2]
    assert speed.min() >= 0
    assert speed.max() <= robot.max_speed
    assert np.abs(yaw_rate).max() <= robot.max_yaw_rate
    np.testing.assert_array_equal(velocities[:, 1], 0)
    # A difference of two float32 numbers near 1 carries 1.2e-7 of rounding, 1.2e-5 per second.
    acceleration = np.abs(np.diff(speed, prepend=0.0)) * robot.rate
    yaw_acceleration = np.abs(np.diff(yaw_rate, prepend=0.0)) * robot.rate
    assert acceleration.max() <= robot.max_acceleration + 2e-5
    assert yaw_acceleration.max() <= robot.max_yaw_acceleration + 2e-5


def test_robot_never_touches_a_wall(driven) -> None:
    segments, _, motion = driven
    points = np.asarray(motion.poses[::5, :2], np.float64)[:, None]
    start, along = segments[None, :, :2], segments[None, :, 2:] - segments[None, :, :2]
    fraction = ((points - start) * along).sum(-1) / (along**2).sum(-1)
    nearest = start + np.clip(fraction, 0, 1)[..., None] * along
    distance = np.linalg.norm(points - nearest, axis=-1).min()
    # Between the poses looked at it drives at most 0.05 m.
    assert distance > Robot().radius + 0.05


def test_all_waypoints_are_passed_in_order(driven) -> None:
    _, tour, motion = driven
    targets, poses = np.asarray(motion.targets), np.asarray(motion.poses, np.float64)
    assert (np.diff(targets) >= 0).all()
    assert targets.max() >= 11
    for leg in range(1, min(targets.max(), len(tour)) + 1):
        passed = poses[np.argmax(targets >= leg), :2]
        # The switch distance plus what it strays from the leg.
        assert np.linalg.norm(passed - tour[leg % len(tour)]) < Robot().switch_distance + 0.1


@pytest.mark.parametrize("builder", [hall_small, hall_large])
def test_tours_of_the_halls_end_within_200_s(builder) -> None:
    _, tour, motion = drive_in(builder)
    finished = np.argmax(np.asarray(motion.targets) >= len(tour)) / motion.rate
    assert 185 < finished < 200
    assert np.linalg.norm(motion.poses[int(finished * motion.rate), :2] - tour[0]) < 0.35


def test_it_starts_at_rest_facing_the_second_waypoint() -> None:
    tour = np.array([[1.0, 2.0], [1.0, 5.0], [4.0, 5.0]])
    motion = follow_tour(Robot(), jnp.asarray(tour, jnp.float32), 10)
    np.testing.assert_allclose(motion.poses[0], [1, 2, math.pi / 2], rtol=1e-6)
    assert motion.velocities[0, 0] == pytest.approx(0.5 / 100)


def test_it_turns_round_at_the_end_of_a_dead_end() -> None:
    tour = jnp.array([[0.0, 0.0], [3.0, 0.0]])
    motion = follow_tour(Robot(), tour, 3000)
    assert motion.targets[-1] >= 3
    assert np.abs(motion.poses[:, 1]).max() < 0.3


def test_poses_between_steps_lie_on_the_arc() -> None:
    motion = follow_tour(Robot(), jnp.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0]]), 400)
    times = np.array([0.0, 3.004, 4.0])
    poses, velocities = motion.at(times)
    np.testing.assert_array_equal(poses[0], motion.poses[0])
    np.testing.assert_array_equal(poses[2], motion.poses[400])
    np.testing.assert_array_equal(velocities[1], motion.velocities[300])
    expected = advance(motion.poses[300], motion.velocities[300], 0.004)
    np.testing.assert_allclose(poses[1], expected, atol=1e-6)
    with pytest.raises(ValueError, match="simulate a longer duration"):
        motion.at(np.array([4.1]))


def test_a_rate_that_is_not_positive_is_refused() -> None:
    with pytest.raises(ValueError, match="rate is 0"):
        Robot(rate=0.0)
