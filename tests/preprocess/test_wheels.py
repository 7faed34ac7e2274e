"""Dead reckoning from wheel angles, against arcs worked out by hand."""

import numpy as np
import pytest

from jaxslam.io.log import JointTrack, LogError
from jaxslam.preprocess.wheels import wheel_odometry

RADIUS, TRACK = 0.05, 0.2


def joints(left, right, names=("wheel_left_joint", "wheel_right_joint")):
    positions = np.stack([left, right], axis=-1).astype(float)
    return JointTrack(
        np.arange(len(left), dtype=float), names, positions, np.full_like(positions, np.nan), "j"
    )


def test_equal_wheels_go_straight():
    poses = wheel_odometry(joints([0, 2, 6], [0, 2, 6]), RADIUS, TRACK).poses
    np.testing.assert_allclose(poses, [[0, 0, 0], [0.1, 0, 0], [0.3, 0, 0]], atol=1e-12)


def test_a_quarter_circle_ends_where_it_should():
    """The inner wheel drives (R − t/2)·π/2, the outer (R + t/2)·π/2, with R = 1 m: to (1, 1), heading π/2."""
    inner, outer = (1 - TRACK / 2) * np.pi / 2 / RADIUS, (1 + TRACK / 2) * np.pi / 2 / RADIUS
    pose = wheel_odometry(joints([0, inner], [0, outer]), RADIUS, TRACK).poses[-1]
    np.testing.assert_allclose(pose, [1, 1, np.pi / 2], atol=1e-12)


def test_turning_on_the_spot_stays_there_and_wraps():
    angle = 1.5 * np.pi * TRACK / 2 / RADIUS
    pose = wheel_odometry(joints([0, -angle], [0, angle]), RADIUS, TRACK).poses[-1]
    np.testing.assert_allclose(pose, [0, 0, -np.pi / 2], atol=1e-12)


def test_readings_without_an_angle_are_left_out():
    track = wheel_odometry(joints([0, np.nan, 2], [0, 1, 2]), RADIUS, TRACK)
    np.testing.assert_array_equal(track.stamps, [0, 2])


def test_what_cannot_be_used_is_refused():
    with pytest.raises(LogError, match="0 joints with 'right' in their names"):
        wheel_odometry(joints([0], [0], names=("wheel_left", "arm")), RADIUS, TRACK)
    with pytest.raises(ValueError, match="the track is 0 m"):
        wheel_odometry(joints([0], [0]), RADIUS, 0)
