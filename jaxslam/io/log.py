"""The in-memory log, independent of the file format: sensor tracks as NumPy arrays on the host.

Stamps are seconds as float64 (float32 cannot represent a Unix time), sorted and finite.
"""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int


class LogError(ValueError):
    """An unusable log. The message is one line: the problem, its place, and the fix."""


@dataclass(frozen=True)
class OdometryTrack:
    """Wheel odometry: integrated base poses.

    Attributes:
        stamps: `[M]` seconds.
        poses: `[M, 3]` base pose in the odometry frame (m, m, rad).
        twists: `[M, 3]` base-frame velocities (m/s, m/s, rad/s); NaN where the log has none.
        topic: source topic or message name.
    """

    stamps: Float64[np.ndarray, "M"]
    poses: Float64[np.ndarray, "M 3"]
    twists: Float64[np.ndarray, "M 3"]
    topic: str

    def __repr__(self) -> str:
        return f"OdometryTrack({_count(self, 'poses')})"


@dataclass(frozen=True)
class ImuTrack:
    """Inertial measurements in the IMU's own frame.

    Attributes:
        stamps: `[M]` seconds.
        orientations: `[M, 4]` quaternion x, y, z, w of the IMU in its reference frame; NaN where absent.
        angular_velocities: `[M, 3]` rad/s.
        linear_accelerations: `[M, 3]` m/s².
        rotation_base_imu: `[3, 3]` mounting, from the static transforms; identity if unknown.
        mounting_known: whether the log contains the mounting of the IMU.
        topic: source topic.
    """

    stamps: Float64[np.ndarray, "M"]
    orientations: Float64[np.ndarray, "M 4"]
    angular_velocities: Float64[np.ndarray, "M 3"]
    linear_accelerations: Float64[np.ndarray, "M 3"]
    rotation_base_imu: Float64[np.ndarray, "3 3"]
    mounting_known: bool
    topic: str

    def __repr__(self) -> str:
        return f"ImuTrack({_count(self, 'readings')})"


@dataclass(frozen=True)
class JointTrack:
    """Joint (wheel) angles.

    Attributes:
        stamps: `[M]` seconds.
        names: `J` joint names.
        positions: `[M, J]` radians; NaN where absent.
        velocities: `[M, J]` rad/s; NaN where absent.
        topic: source topic.
    """

    stamps: Float64[np.ndarray, "M"]
    names: tuple[str, ...]
    positions: Float64[np.ndarray, "M J"]
    velocities: Float64[np.ndarray, "M J"]
    topic: str

    def __repr__(self) -> str:
        return f"JointTrack({_count(self, 'readings')}, {', '.join(self.names)})"


@dataclass(frozen=True)
class FixTrack:
    """Satellite fixes: `[M, 3]` latitude and longitude in degrees, altitude in meters."""

    stamps: Float64[np.ndarray, "M"]
    positions: Float64[np.ndarray, "M 3"]
    topic: str

    def __repr__(self) -> str:
        return f"FixTrack({_count(self, 'fixes')})"


@dataclass(frozen=True)
class ScanTrack:
    """Planar scans. Scans with fewer beams than `B` are padded with NaN at the end.

    Beam `i` of scan `t` points at `angle_min[t] + i * angle_increment[t]` in the lidar frame.

    Attributes:
        stamps: `[T]` seconds.
        ranges: `[T, B]` meters, as recorded; NaN for no beam or no return (the reader replaces 0, negative,
            infinite and out-of-interval ranges by NaN).
        num_beams: `[T]` number of recorded beams of each scan.
        angle_min: `[T]` radians.
        angle_increment: `[T]` radians.
        range_min: smallest range the sensor reports, meters.
        range_max: ranges at or over this are no return, meters.
        pose_base_lidar: `[3]` mounting of the lidar (m, m, rad).
        mounting_known: whether the log contains the mounting of the lidar.
        topic: source topic or message name.
        time_increment: seconds from one beam to the next, the first one at the stamp; None if the log has no
            times of beams within a scan.
    """

    stamps: Float64[np.ndarray, "T"]
    ranges: Float32[np.ndarray, "T B"]
    num_beams: Int[np.ndarray, "T"]
    angle_min: Float64[np.ndarray, "T"]
    angle_increment: Float64[np.ndarray, "T"]
    range_min: float
    range_max: float
    pose_base_lidar: Float64[np.ndarray, "3"]
    mounting_known: bool
    topic: str
    time_increment: float | None = None

    def __repr__(self) -> str:
        return f"ScanTrack({_count(self, 'scans')}, {self.ranges.shape[-1]} beams)"


Track = OdometryTrack | ImuTrack | JointTrack | FixTrack | ScanTrack
_AnyTrack = TypeVar("_AnyTrack", bound=Track)


@dataclass(frozen=True)
class SensorLog:
    """All tracks of a log file that this library can use.

    Attributes:
        path: the file or folder of the log, or the name of a simulated log.
        odometry, imu, joints, fixes, scans: the tracks, or None if the log has none.
        warnings: one line per kind of repaired or skipped data, with counts.
        topics: message count by topic or message name, for everything in the file, used or not.
    """

    path: Path
    odometry: OdometryTrack | None = None
    imu: ImuTrack | None = None
    joints: JointTrack | None = None
    fixes: FixTrack | None = None
    scans: ScanTrack | None = None
    warnings: tuple[str, ...] = ()
    topics: dict[str, int] = field(default_factory=dict)

    def __repr__(self) -> str:
        tracks = {
            "scans": self.scans,
            "odometry poses": self.odometry,
            "IMU readings": self.imu,
            "joint readings": self.joints,
            "fixes": self.fixes,
        }
        parts = [f"{len(track.stamps)} {unit}" for unit, track in tracks.items() if track is not None]
        parts += [f"{len(self.warnings)} warnings"] if self.warnings else []
        return f"SensorLog({self.path}: {', '.join(parts) or 'nothing'})"

    @property
    def tracks(self) -> dict[str, Track]:
        """Return the tracks that the log has, by attribute name."""
        return {name: value for name, value in vars(self).items() if isinstance(value, Track)}

    def between(self, start: float, end: float) -> "SensorLog":
        """Return the part of the log between two times, both included, with its original stamps.

        Args:
            start: seconds since the first scan.
            end: seconds since the first scan; infinity for the end of the log.

        Raises:
            LogError: the log has no scan in that interval.
        """
        if self.scans is None or not len(self.scans.stamps):
            raise LogError(f"{self.path} has no scans: times are counted from the first scan")
        first, last = self.scans.stamps[[0, -1]]
        if not ((self.scans.stamps >= first + start) & (self.scans.stamps <= first + end)).any():
            raise LogError(
                f"{self.path} has no scan from {start} to {end} s: scans are from 0 to {last - first:.1f} s"
            )
        parts: dict[str, Any] = {}
        for name, track in self.tracks.items():
            parts[name] = select_rows(track, (track.stamps >= first + start) & (track.stamps <= first + end))
        return dataclasses.replace(self, **parts)


def select_rows(track: _AnyTrack, rows: Bool[np.ndarray, "M"] | Int[np.ndarray, "N"]) -> _AnyTrack:
    """Return the track with only the given rows of all arrays that have one row per stamp."""
    mountings = ("rotation_base_imu", "pose_base_lidar")
    selected = {
        name: value[rows]
        for name, value in vars(track).items()
        if isinstance(value, np.ndarray) and name not in mountings
    }
    return dataclasses.replace(track, **selected)


def list_counts(counts: Mapping[str, int]) -> str:
    """Return the names and counts as text, sorted by name: `/odom (5), /scan (2)`."""
    return ", ".join(f"{name} ({count})" for name, count in sorted(counts.items()))


def _count(track: Track, unit: str) -> str:
    """Describe the number of rows of a track, its topic and its duration."""
    stamps = track.stamps
    duration = f", {stamps[-1] - stamps[0]:.1f} s" if len(stamps) else ""
    return f"{len(stamps)} {unit} on {track.topic}{duration}"
