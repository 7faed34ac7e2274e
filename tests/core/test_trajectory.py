"""Host-side SE(2): against homogeneous matrices and scipy, and what stamps and ranges repair."""

import subprocess
import sys

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxslam.core import se2
from jaxslam.core.trajectory import (
    interpolate_along_odometry,
    interpolate_poses,
    net_rotation,
    path_length,
    yaw_from_quaternion,
)
from jaxslam.io.ranges import clean_ranges, saturated_reading
from jaxslam.io.stamps import largest_step_back, nearest_rows, sorting_order, spread_repeats


def matrix(pose):
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return np.array([[cos, -sin, pose[0]], [sin, cos, pose[1]], [0, 0, 1]])


@pytest.fixture
def pose_pairs():
    return np.random.default_rng(0).uniform(-4, 4, (2, 50, 3))


def test_composition_is_the_product_of_matrices(pose_pairs):
    first, second = pose_pairs
    for a, b, c in zip(first, second, se2.compose(first, second), strict=True):
        np.testing.assert_allclose(matrix(c), matrix(a) @ matrix(b), atol=1e-12)


def test_inverse_and_relative_undo_composition(pose_pairs):
    first, second = pose_pairs
    for a, b in zip(first, se2.inverse(first), strict=True):
        np.testing.assert_allclose(matrix(b), np.linalg.inv(matrix(a)), atol=1e-12)
    back = se2.compose(first, se2.relative(first, second))
    np.testing.assert_allclose(back[:, :2], second[:, :2], atol=1e-12)
    np.testing.assert_allclose(se2.wrap(back[:, 2] - second[:, 2]), 0, atol=1e-12)


def test_wrapped_angles_are_half_open():
    angles = np.array([np.pi, -np.pi, 3 * np.pi / 2, -1e-17, 7.0])
    expected = [-np.pi, -np.pi, -np.pi / 2, 0.0, 7.0 - 2 * np.pi]
    np.testing.assert_allclose(se2.wrap(angles), expected, atol=1e-12)
    assert (se2.wrap(angles) < np.pi).all()


def test_interpolation_goes_along_the_shorter_arc_and_holds_the_ends():
    poses = np.array([[0.0, 0.0, 3.0], [2.0, 4.0, -3.0]])
    result = interpolate_poses(np.array([10.0, 12.0]), poses, np.array([9.0, 11.0, 11.5, 13.0]))
    np.testing.assert_allclose(result[:, :2], [[0, 0], [1, 2], [1.5, 3], [2, 4]])
    # From 3 rad on by 2π − 6 = 0.2832 rad: half of it is at ±π, three quarters at −3.0708.
    np.testing.assert_allclose(result[:, 2], [3.0, -np.pi, 3.0 + 0.75 * (2 * np.pi - 6) - 2 * np.pi, -3.0])


def test_interpolation_refuses_what_is_no_trajectory():
    with pytest.raises(ValueError, match="empty"):
        interpolate_poses(np.zeros(0), np.zeros((0, 3)), np.zeros(1))
    with pytest.raises(ValueError, match="row 2"):
        interpolate_poses(np.array([0.0, 2.0, 1.0]), np.zeros((3, 3)), np.zeros(1))


def test_path_length_and_rotation_count_full_turns():
    theta = np.linspace(0, 4 * np.pi, 101)
    poses = np.stack([np.linspace(0, 3, 101), np.linspace(0, 4, 101), theta], axis=1)
    assert path_length(poses) == pytest.approx(5.0)
    assert net_rotation(poses) == pytest.approx(4 * np.pi)


def test_yaw_is_that_of_scipys_euler_angles():
    rotations = Rotation.random(100, rng=np.random.default_rng(1))
    yaw = yaw_from_quaternion(3.0 * rotations.as_quat())
    np.testing.assert_allclose(yaw, rotations.as_euler("ZYX")[:, 0], atol=1e-12)


def test_disorder_of_stamps_is_measured_and_sorted_stably():
    stamps = np.array([0.0, 2.0, 1.5, 1.7, 3.0, 3.0])
    assert largest_step_back(stamps) == (0.5, 2)
    assert largest_step_back(np.zeros(0)) == (0.0, 0)
    warnings = []
    assert sorting_order(stamps, "ODOM", warnings).tolist() == [0, 2, 3, 1, 4, 5]
    assert warnings == ["ODOM: 2 stamps run backwards by up to 0.500 s: sorted by time"]


def test_the_nearest_stamp_is_found():
    stamps, queries = np.array([0.0, 1.0, 3.0]), np.array([[-9.0, 0.5], [2.1, 9.0]])
    assert nearest_rows(stamps, queries).tolist() == [[0, 0], [2, 2]]
    assert nearest_rows(stamps[:1], queries).tolist() == [[0, 0], [0, 0]]


def test_repeated_stamps_are_spread_up_to_the_next():
    stamps, moved = spread_repeats(np.array([0.0, 1.0, 1.0, 1.0, 2.5, 4.0, 4.0]))
    # Steps 1, 1.5, 1.5: three stamps share [1, 2.5), the two at the end the median period 1.5.
    np.testing.assert_allclose(stamps, [0.0, 1.0, 1.5, 2.0, 2.5, 4.0, 4.75])
    assert moved == 3
    assert spread_repeats(np.array([7.0, 7.0]))[0].tolist() == [7.0, 7.5]


def test_returns_lie_inside_the_half_open_interval():
    ranges = np.array([[0.0, -1.0, np.inf, np.nan, 0.01, 0.02, 4.99, 5.0]])
    cleaned = clean_ranges(ranges, 0.02, 5.0)
    assert cleaned.dtype == np.float32
    assert np.isfinite(cleaned).tolist() == [[False] * 5 + [True, True, False]]


@pytest.mark.parametrize(
    ("largest", "copies", "expected"),
    [
        (81.91, 1, 81.825),  # SICK codes in cm: one is enough.
        (8.191, 1, 8.1825),  # and in mm
        (50.0, 2, 50.0),  # several in each of three scans: saturated
        (50.0, 1, None),  # one in each: a wall may be there
        (8.1, 1, None),
    ],
)
def test_saturated_readings_are_recognized(largest, copies, expected):
    ranges = np.tile(np.linspace(0.5, 7.0, 20), (3, 1))
    ranges[:, :copies] = largest
    found = saturated_reading(ranges)
    assert found == (None if expected is None else pytest.approx(expected))
    assert saturated_reading(np.full((3, 4), np.nan)) is None
    assert saturated_reading(np.full((3, 4), 2.0)) is None  # A round room, not a lidar's limit.


def test_the_farthest_wall_is_not_saturation():
    # A wall square to the beam at 6 m, in whole centimeters: the largest value stands twice in
    # every scan, with readings just below it.
    angles = np.deg2rad(np.arange(-40, 41))
    wall = np.round(6.0 * np.ones(81), 2)
    wall[np.abs(angles) > 0.02] = np.round(5.5 + 0.4 * np.cos(angles), 2)[np.abs(angles) > 0.02]
    ranges = np.tile(np.concatenate([wall, np.full(20, 1.0)]), (5, 1))
    assert saturated_reading(ranges) is None


def test_importing_the_package_needs_no_optional_dependency():
    code = (
        "import sys, jaxslam.io; "
        "found = {'rosbags', 'PIL', 'matplotlib', 'ruamel'} & set(sys.modules); "
        "assert not found, found"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_poses_along_lead_from_one_known_pose_to_the_next():
    odometry = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    result = interpolate_along_odometry(
        odometry, np.array([0, 2]), np.array([[5.0, 0.0, 0.0], [7.2, 0.4, 0.0]])
    )
    np.testing.assert_allclose(result, [[5.0, 0.0, 0.0], [6.1, 0.2, 0.0], [7.2, 0.4, 0.0]], atol=1e-12)


def test_poses_along_weigh_by_the_way_and_not_by_the_count():
    # Three looks while the robot stands, then a meter: standing moves nothing.
    odometry = np.array([[0.0, 0.0, 0.0]] * 3 + [[1.0, 0.0, 0.0]])
    result = interpolate_along_odometry(
        odometry, np.array([0, 3]), np.array([[0.0, 0.0, 0.0], [1.3, 0.0, 0.0]])
    )
    np.testing.assert_allclose(result[:, 0], [0.0, 0.0, 0.0, 1.3], atol=1e-12)


def test_poses_along_follow_odometry_where_it_was_right():
    rng = np.random.default_rng(0)
    odometry = np.cumsum(rng.normal(size=(40, 3)) * [0.1, 0.1, 0.5], axis=0)
    odometry[:, 2] = se2.wrap(odometry[:, 2])
    start = np.array([3.0, -2.0, 3.1])
    truth = se2.compose(start, se2.relative(odometry[0], odometry))
    rows = np.array([4, 5, 17, 30])
    result = interpolate_along_odometry(odometry, rows, truth[rows])
    # Rows before the first and after the last known one included, and headings across ±π.
    np.testing.assert_allclose(result[:, :2], truth[:, :2], atol=1e-9)
    np.testing.assert_allclose(se2.wrap(result[:, 2] - truth[:, 2]), 0.0, atol=1e-9)


def test_poses_along_average_headings_across_pi():
    odometry = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    known = np.array([[0.0, 0.0, np.pi - 0.1], [-2.0, 0.0, -np.pi + 0.1]])
    middle = interpolate_along_odometry(odometry, np.array([0, 2]), known)[1]
    np.testing.assert_allclose(np.abs(middle[2]), np.pi, atol=1e-9)
    np.testing.assert_allclose(middle[0], -1.0, atol=0.02)


def test_poses_along_one_known_pose_only():
    odometry = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.5]])
    result = interpolate_along_odometry(odometry, np.array([1]), np.array([[4.0, 0.0, 0.5]]))
    np.testing.assert_allclose(result, [[3.0, 0.0, 0.0], [4.0, 0.0, 0.5]], atol=1e-12)
