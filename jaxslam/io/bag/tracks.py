"""Message lists of a bag → tracks: header stamps, sorting, padding of scans, missing values."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float64

from jaxslam.core.trajectory import yaw_from_quaternion
from jaxslam.io.bag.file import BagMessage
from jaxslam.io.bag.transforms import PlanarMounting
from jaxslam.io.log import FixTrack, ImuTrack, JointTrack, LogError, OdometryTrack, ScanTrack
from jaxslam.io.ranges import clean_ranges
from jaxslam.io.stamps import MAX_BACKWARD_S, backward_steps, sorting_order


class TimedMessages(NamedTuple):
    """Message contents sorted by time, with their stamps `[M]` in seconds."""

    stamps: Float64[np.ndarray, "M"]
    contents: list[Any]


def in_order(path: Path, topic: str, messages: Sequence[BagMessage], warnings: list[str]) -> TimedMessages:
    """Sort messages by the header's stamp, or by the time of receipt if all header stamps are zero.

    Args:
        path: the bag, for the error message.
        topic: topic of the messages.
        messages: messages in the order of receipt.
        warnings: list to which a line per repair is appended.

    Raises:
        LogError: the stamps jump back by more than a second.
    """
    header = np.array([_seconds(message.content.header.stamp) for message in messages])
    received = np.array([message.received for message in messages])
    if header.size and not header.any():
        warnings.append(f"{topic}: header stamps are zero, time of receipt used")
        header = received
    steps = backward_steps(header)
    if steps.largest > MAX_BACKWARD_S:
        raise LogError(
            f"{path}: stamps of {topic} run back by {steps.largest:.1f} s at message "
            f"{steps.row + 1} of {header.size} (clock set back, or a simulation restarted?): "
            "cut the bag there"
        )
    if steps.num_backward:
        warnings.append(
            f"{topic}: {steps.num_backward} stamps run back by up to {steps.largest:.3f} s: sorted by time"
        )
    order = sorting_order(header)
    return TimedMessages(header[order], [messages[row].content for row in order])


def common_frame(contents: Sequence[Any], *, child: bool = False) -> str:
    """Return the most frequent frame of the headers (or child frame), without leading slash."""
    names = Counter(m.child_frame_id if child else m.header.frame_id for m in contents)
    return names.most_common(1)[0][0].lstrip("/") if names else ""


def odometry_track(timed: TimedMessages, topic: str, warnings: list[str]) -> OdometryTrack | None:
    """Convert `nav_msgs/Odometry` to planar poses; drop messages whose pose is not finite."""
    rows = np.array(
        [
            (
                *_vector(m.pose.pose.position)[:2],
                *_quaternion(m.pose.pose.orientation),
                *_vector(m.twist.twist.linear)[:2],
                m.twist.twist.angular.z,
            )
            for m in timed.contents
        ],
        dtype=np.float64,
    ).reshape(-1, 9)
    quaternions = rows[:, 2:6]
    good = np.isfinite(rows[:, :6]).all(axis=1) & (np.abs(quaternions).max(axis=1, initial=0) > 0)
    _warn_dropped(warnings, topic, good, "poses that are not finite")
    poses = np.stack([rows[:, 0], rows[:, 1], yaw_from_quaternion(quaternions)], axis=1)
    if not good.any():
        return None
    return OdometryTrack(timed.stamps[good], poses[good], rows[good, 6:], topic)


def imu_track(timed: TimedMessages, topic: str, rotation: Float64[np.ndarray, "3 3"] | None) -> ImuTrack:
    """Convert `sensor_msgs/Imu`; values marked as absent (covariance −1, zero quaternion) become NaN."""
    orientations = np.array([_quaternion(m.orientation) for m in timed.contents])
    rates = np.array([_vector(m.angular_velocity) for m in timed.contents])
    accelerations = np.array([_vector(m.linear_acceleration) for m in timed.contents])
    absent = np.array(
        [
            (
                m.orientation_covariance[0] == -1,
                m.angular_velocity_covariance[0] == -1,
                m.linear_acceleration_covariance[0] == -1,
            )
            for m in timed.contents
        ]
    )
    orientations[absent[:, 0] | (np.abs(orientations).max(axis=1) == 0)] = np.nan
    rates[absent[:, 1]] = np.nan
    accelerations[absent[:, 2]] = np.nan
    mounting = np.eye(3) if rotation is None else rotation
    return ImuTrack(timed.stamps, orientations, rates, accelerations, mounting, rotation is not None, topic)


def joint_track(timed: TimedMessages, topic: str) -> JointTrack:
    """Convert `sensor_msgs/JointState`; joints missing from a message are NaN in its row."""
    names = tuple(dict.fromkeys(name for m in timed.contents for name in m.name))
    columns = {name: column for column, name in enumerate(names)}
    tracks = np.full((2, timed.stamps.size, len(names)), np.nan)
    for row, m in enumerate(timed.contents):
        for track, values in zip(tracks, (m.position, m.velocity), strict=True):
            for name, value in zip(m.name, values, strict=False):  # Velocities are often left out.
                track[row, columns[name]] = value
    return JointTrack(timed.stamps, names, tracks[0], tracks[1], topic)


def fix_track(timed: TimedMessages, topic: str, warnings: list[str]) -> FixTrack | None:
    """Convert `sensor_msgs/NavSatFix`; drop messages without a fix."""
    positions = np.array([(m.latitude, m.longitude, m.altitude) for m in timed.contents])
    status = np.array([m.status.status for m in timed.contents])
    good = (status >= 0) & np.isfinite(positions[:, :2]).all(axis=1)
    _warn_dropped(warnings, topic, good, "messages without a fix")
    return FixTrack(timed.stamps[good], positions[good], topic) if good.any() else None


def scan_track(
    timed: TimedMessages, topic: str, mounting: PlanarMounting | None, warnings: list[str]
) -> ScanTrack | None:
    """Convert `sensor_msgs/LaserScan` with any number of beams, which may change between messages.

    Args:
        timed: the messages.
        topic: topic of the messages.
        mounting: mounting of the lidar, None if it is unknown.
        warnings: list to which a line about dropped messages is appended.

    Returns:
        The track, with negated angles if the lidar is upside down. None if no message has a beam.
    """
    geometry, good = _scan_geometry(timed.contents)
    _warn_dropped(warnings, topic, good, "scans without beams or beam angles")
    if not good.any():
        return None
    geometry = geometry[good]
    contents = [m for m, keep in zip(timed.contents, good, strict=True) if keep]
    num_beams = np.array([len(m.ranges) for m in contents], dtype=np.int64)
    ranges = np.full((len(contents), int(num_beams.max())), np.nan)
    for row, m in zip(ranges, contents, strict=True):
        row[: len(m.ranges)] = m.ranges
    cleaned = clean_ranges(ranges, geometry[:, 2:3], geometry[:, 3:4])
    if not np.isfinite(cleaned).any():
        warnings.append(f"{topic}: no scan has a return inside its range interval")
    mirror = -1.0 if mounting is not None and mounting.upside_down else 1.0
    return ScanTrack(
        timed.stamps[good],
        cleaned,
        num_beams,
        mirror * geometry[:, 0],
        mirror * geometry[:, 1],
        float(geometry[:, 2].min()),
        float(geometry[:, 3].max()),
        np.zeros(3) if mounting is None else mounting.pose,
        mounting is not None,
        topic,
        _time_increment(contents),
    )


def _time_increment(contents: Sequence[Any]) -> float:
    """Return the seconds between beams; 0, which many drivers leave, means that all are simultaneous."""
    increments = np.array([m.time_increment for m in contents], dtype=np.float64)
    usual = float(np.median(increments[np.isfinite(increments)])) if np.isfinite(increments).any() else 0.0
    return max(usual, 0.0)


def _scan_geometry(
    contents: Sequence[Any],
) -> tuple[Float64[np.ndarray, "T 4"], Bool[np.ndarray, "T"]]:
    """Return the first angle, angle increment and range interval of each scan, and which scans are valid."""
    counts = np.array([len(m.ranges) for m in contents], dtype=np.int64)
    header = np.array(
        [(m.angle_min, m.angle_max, m.angle_increment, m.range_min, m.range_max) for m in contents],
        dtype=np.float64,
    ).reshape(-1, 5)
    first, last, increment, range_min, range_max = header.T
    # Some drivers leave the increment at zero; then it follows from the end angles.
    implied = (last - first) / np.maximum(counts - 1, 1)
    increment = np.where(np.isfinite(increment) & (increment != 0), increment, implied)
    range_min = np.where(range_min > 0, range_min, 0.0)
    range_max = np.where(range_max > 0, range_max, np.inf)
    good = (counts > 0) & np.isfinite(first) & np.isfinite(increment)
    good &= (increment != 0) | (counts == 1)
    return np.stack([first, increment, range_min, range_max], axis=1), good


def _warn_dropped(warnings: list[str], topic: str, good: Bool[np.ndarray, "M"], what: str) -> None:
    dropped = int(np.count_nonzero(~good))
    if dropped:
        warnings.append(f"{topic}: {dropped} {what} skipped")


def _quaternion(q: Any) -> tuple[float, float, float, float]:
    return q.x, q.y, q.z, q.w


def _seconds(stamp: Any) -> float:
    return stamp.sec + stamp.nanosec * 1e-9


def _vector(v: Any) -> tuple[float, float, float]:
    return v.x, v.y, v.z
