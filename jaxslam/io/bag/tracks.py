"""Message lists of a bag → tracks: header stamps, sorting, padding of scans, missing values."""

from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float64

from jaxslam.core.trajectory import yaw_from_quaternion
from jaxslam.io.bag.transforms import PlanarMounting, xyz, xyzw
from jaxslam.io.log import FixTrack, ImuTrack, JointTrack, LogError, OdometryTrack, ScanTrack
from jaxslam.io.ranges import clean_ranges, pad_ranges
from jaxslam.io.stamps import MAX_BACKWARD_S, largest_step_back, sorting_order


class TimedMessages(NamedTuple):
    """Message contents of a topic sorted by time, with their stamps `[M]` in seconds."""

    topic: str
    stamps: Float64[np.ndarray, "M"]
    contents: list[Any]


def in_order(
    path: Path, topic: str, messages: Sequence[tuple[Any, float]], warnings: list[str]
) -> TimedMessages:
    """Sort messages by the header's stamp, or by the time of receipt if all header stamps are zero.

    Args:
        path: the bag, for the error message.
        topic: topic of the messages.
        messages: content and time of receipt of each message, in the order of receipt.
        warnings: list to which a line per repair is appended.

    Raises:
        LogError: there are no messages, or the stamps jump back by more than a second.
    """
    if not messages:
        raise LogError(f"{path}: the messages of {topic} are missing: the bag is damaged, copy it again")
    contents, received = zip(*messages, strict=True)
    stamps = np.array([m.header.stamp.sec + m.header.stamp.nanosec * 1e-9 for m in contents])
    if not stamps.any():
        warnings.append(f"{topic}: header stamps are zero, time of receipt used")
        stamps = np.array(received)
    largest, row = largest_step_back(stamps)
    if largest > MAX_BACKWARD_S:
        raise LogError(
            f"{path}: stamps of {topic} run backwards by {largest:.1f} s at message "
            f"{row + 1} of {stamps.size} (clock set back, or a simulation restarted?): "
            "cut the bag there"
        )
    order = sorting_order(stamps, topic, warnings)
    return TimedMessages(topic, stamps[order], [contents[row] for row in order])


def common_frame(names: Iterable[str]) -> str:
    """Return the most frequent frame without leading slash."""
    return Counter(names).most_common(1)[0][0].lstrip("/")


def odometry_track(timed: TimedMessages, warnings: list[str]) -> OdometryTrack | None:
    """Convert `nav_msgs/Odometry` to planar poses; drop messages whose pose is not finite."""
    positions = np.array([xyz(m.pose.pose.position)[:2] for m in timed.contents], dtype=np.float64)
    quaternions = np.array([xyzw(m.pose.pose.orientation) for m in timed.contents], dtype=np.float64)
    linear = np.array([xyz(m.twist.twist.linear)[:2] for m in timed.contents], dtype=np.float64)
    angular = np.array([m.twist.twist.angular.z for m in timed.contents], dtype=np.float64)
    good = np.isfinite(positions).all(axis=1) & np.isfinite(quaternions).all(axis=1)
    good &= np.abs(quaternions).max(axis=1) > 0
    _warn_dropped(warnings, timed.topic, good, "poses that are not finite")
    if not good.any():
        return None
    poses = np.column_stack([positions, yaw_from_quaternion(quaternions)])
    twists = np.column_stack([linear, angular])
    return OdometryTrack(timed.stamps[good], poses[good], twists[good], timed.topic)


def imu_track(timed: TimedMessages, rotation: Float64[np.ndarray, "3 3"] | None) -> ImuTrack:
    """Convert `sensor_msgs/Imu`; values marked as absent (covariance −1, zero quaternion) become NaN."""
    orientations = np.array([xyzw(m.orientation) for m in timed.contents])
    rates = np.array([xyz(m.angular_velocity) for m in timed.contents])
    accelerations = np.array([xyz(m.linear_acceleration) for m in timed.contents])
    orientations[np.abs(orientations).max(axis=1) == 0] = np.nan
    for values, name in (
        (orientations, "orientation"),
        (rates, "angular_velocity"),
        (accelerations, "linear_acceleration"),
    ):
        values[[getattr(m, f"{name}_covariance")[0] == -1 for m in timed.contents]] = np.nan
    mounting = np.eye(3) if rotation is None else rotation
    known = rotation is not None
    return ImuTrack(timed.stamps, orientations, rates, accelerations, mounting, known, timed.topic)


def joint_track(timed: TimedMessages) -> JointTrack:
    """Convert `sensor_msgs/JointState`; joints missing from a message are NaN in its row."""
    names = tuple(dict.fromkeys(name for m in timed.contents for name in m.name))
    columns = {name: column for column, name in enumerate(names)}
    tracks = np.full((2, timed.stamps.size, len(names)), np.nan)
    for row, m in enumerate(timed.contents):
        for track, values in zip(tracks, (m.position, m.velocity), strict=True):
            for name, value in zip(m.name, values, strict=False):  # Velocities are often left out.
                track[row, columns[name]] = value
    return JointTrack(timed.stamps, names, tracks[0], tracks[1], timed.topic)


def fix_track(timed: TimedMessages, warnings: list[str]) -> FixTrack | None:
    """Convert `sensor_msgs/NavSatFix`; drop messages without a fix."""
    positions = np.array([(m.latitude, m.longitude, m.altitude) for m in timed.contents])
    status = np.array([m.status.status for m in timed.contents])
    good = (status >= 0) & np.isfinite(positions[:, :2]).all(axis=1)
    _warn_dropped(warnings, timed.topic, good, "messages without a fix")
    return FixTrack(timed.stamps[good], positions[good], timed.topic) if good.any() else None


def scan_track(
    timed: TimedMessages, mounting: PlanarMounting | None, warnings: list[str]
) -> ScanTrack | None:
    """Convert `sensor_msgs/LaserScan` with any number of beams, which may change between messages.

    Args:
        timed: the messages.
        mounting: mounting of the lidar, None if it is unknown.
        warnings: list to which a line about dropped messages is appended.

    Returns:
        The track, with negated angles if the lidar is upside down. None if no message has a beam.
    """
    geometry, good = _scan_geometry(timed.contents)
    _warn_dropped(warnings, timed.topic, good, "scans without beams or beam angles")
    if not good.any():
        return None
    geometry = geometry[good]
    contents = [m for m, keep in zip(timed.contents, good, strict=True) if keep]
    ranges, num_beams = pad_ranges([m.ranges for m in contents])
    cleaned = clean_ranges(ranges, geometry[:, 2:3], geometry[:, 3:4])
    if not np.isfinite(cleaned).any():
        warnings.append(f"{timed.topic}: no scan has a return inside its range interval")
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
        timed.topic,
        _time_increment(contents),
    )


def _time_increment(contents: Sequence[Any]) -> float:
    """Return the seconds between beams; 0, which many drivers send, means simultaneous beams."""
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
