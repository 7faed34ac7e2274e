"""Beam angles, maximum range and mounting of the front laser of a CARMEN log."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float64

from jaxslam.core import se2
from jaxslam.io.carmen.messages import LaserMessage
from jaxslam.io.ranges import SICK_CODES, saturated_reading

# The Hokuyo URG sends error codes as readings of 0 to 19 mm; planar lidars do not measure shorter ranges.
RANGE_MIN = 0.02

# Laser and robot pose usually have six digits; half a centimeter and 0.3° also allow logs with two or
# three digits.
_MOUNTING_TOLERANCE = np.array([0.005, 0.005, 0.005])
_MOUNTING_SHARE = 0.9


def beam_angles(message: LaserMessage, parameters: Mapping[str, str]) -> tuple[float, float]:
    """Return the angle of the first beam and between neighboring beams of one scan, radians, lidar frame.

    `RAWLASER1` and `ROBOTLASER1` contain it. `FLASER` does not: its n beams are spread symmetrically
    over the field of view `PARAM laser_front_laser_fov` (degrees, default 180°). The step is
    `PARAM laser_front_laser_resolution` (degrees) if it agrees with the number of beams and the field
    of view; else an odd n includes both end points, and an even n has a step of fov / n.

    Example:
        181 beams: −90° to 90° in steps of 1°. 180 beams: −90° to 89°, also in steps of 1°.
    """
    count = message.ranges.size
    if math.isfinite(message.start):
        return message.start, _exact_step(message.fov, message.step, count)
    fov = math.radians(_number(parameters, "laser_front_laser_fov", 10.0, 360.0) or 180.0)
    step = fov / max(count - 1 if count % 2 else count, 1)
    resolution = math.radians(_number(parameters, "laser_front_laser_resolution", 0.01, 45.0) or 0)
    if resolution and abs(resolution * count - fov) <= 1.01 * resolution:
        step = resolution
    return -fov / 2, step


def _exact_step(fov: float, step: float, count: int) -> float:
    """Return the step implied by the field of view if it equals the written one up to rounding."""
    candidates = [fov / divisor for divisor in (count - 1, count) if divisor > 0]
    for candidate in candidates:
        if abs(candidate - step) < 1e-6:
            return candidate
    plausible = 0 < abs(step) * (count - 1) < 2 * math.pi + abs(step)
    return step if plausible or not candidates else candidates[0]


def _number(parameters: Mapping[str, str], name: str, low: float, high: float) -> float | None:
    try:
        value = float(parameters[name])
    except (KeyError, ValueError):
        return None
    return value if low <= value <= high else None


def maximum_range(
    messages: Sequence[LaserMessage],
    ranges: Float64[np.ndarray, "T B"],
    parameters: Mapping[str, str],
    warnings: list[str],
) -> float:
    """Return the range in meters from which a reading is no return.

    It is the smallest of the message field, `PARAM robot_front_laser_max`, and the saturated reading in
    the data (`saturated_reading`). If none of these exists, it is the full scale of a SICK LMS that
    covers every reading (8.18 or 81.8 m), and a warning is appended.
    """
    named = [message.range_max for message in messages if message.range_max > 0]
    candidates = [max(named)] if named else []
    parameter = _number(parameters, "robot_front_laser_max", 0.1, 1000.0)
    saturated = saturated_reading(ranges)
    candidates += [value for value in (parameter, saturated) if value is not None]
    if candidates:
        return min(candidates)
    largest = np.max(ranges, where=np.isfinite(ranges), initial=0.0)
    scales = [(SICK_CODES[0][0] - 0.5) * unit for unit in (1e-3, 1e-2)]
    guess = next((scale for scale in scales if scale > largest), math.inf)
    warnings.append(
        f"the lidar's maximum range is not in the log: {guess:g} m assumed, "
        f"the largest reading is {largest:.2f} m"
    )
    return guess


def mounting(
    pose_robot: Float64[np.ndarray, "T 3"],
    pose_laser: Float64[np.ndarray, "T 3"],
    parameters: Mapping[str, str],
    warnings: list[str],
) -> tuple[Float64[np.ndarray, "3"], bool]:
    """Return the pose of the lidar in the robot's frame.

    It is the median of laser ⊖ robot over the scans if the poses differ, by the same offset in nine of
    ten scans; else `PARAM robot_frontlaser_offset` (and `_side_offset`, `_angular_offset`). Otherwise
    it is unknown, because logs converted from other formats contain the robot's pose twice.

    Args:
        pose_robot: `[T, 3]` odometry pose of every scan, NaN if the message has none.
        pose_laser: `[T, 3]` laser pose of every scan in the same frame.
        parameters: the log's `PARAM` values.
        warnings: list to which a line is appended if the offsets are inconsistent.

    Returns:
        The pose `[3]`, and whether it is known from the log.
    """
    given = np.isfinite(pose_robot).all(axis=1) & np.isfinite(pose_laser).all(axis=1)
    if given.any():
        offsets = se2.relative(pose_robot[given], pose_laser[given])
        center = _median_pose(offsets)
        spread = np.abs(offsets - center)
        spread[:, 2] = np.abs(se2.wrap(offsets[:, 2] - center[2]))
        consistent = np.mean((spread <= _MOUNTING_TOLERANCE).all(axis=1)) >= _MOUNTING_SHARE
        if consistent and np.abs(center).max() > 1e-4:
            return np.round(center, 6), True  # The precision of a log.
        if not consistent:
            warnings.append(
                "the scans' laser and robot poses do not differ by a fixed mounting "
                "(poses corrected afterwards?): not used for the mounting"
            )
    offset = _number(parameters, "robot_frontlaser_offset", -10.0, 10.0)
    if offset is None:
        return np.zeros(3), False
    side = _number(parameters, "robot_frontlaser_side_offset", -10.0, 10.0) or 0.0
    angle = _number(parameters, "robot_frontlaser_angular_offset", -360.0, 360.0) or 0.0
    if abs(angle) > math.pi:  # CARMEN adds radians; a larger number can only be degrees.
        angle = math.radians(angle)
    return np.array([offset, side, angle]), True


def _median_pose(poses: Float64[np.ndarray, "T 3"]) -> Float64[np.ndarray, "3"]:
    """Return the component-wise median; theta as differences to the first pose, which may lie at ±π."""
    reference = poses[0, 2]
    theta = se2.wrap(reference + np.median(se2.wrap(poses[:, 2] - reference), keepdims=True))
    return np.concatenate([np.median(poses[:, :2], axis=0), theta])
