"""Trajectories on the host: interpolation, dead reckoning, length and rotation, in NumPy and float64.

float32 would lose centimeters on a map in UTM coordinates. Poses are `[..., 3]` = (x m, y m, theta rad);
returned angles lie in [−π, π).
"""

from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float64, Int

from jaxslam.core import se2

Alignment = Literal["se2", "first_pose", False]
"""How an estimate is aligned with its reference: as a whole, by the first pose, or not at all."""


class Trajectory(NamedTuple):
    """A stamped trajectory.

    Attributes:
        stamps: `[M]` seconds.
        poses: `[M, 3]` (m, m, rad).
    """

    stamps: Float64[np.ndarray, "M"]
    poses: Float64[np.ndarray, "M 3"]

    def __repr__(self) -> str:
        length, duration = path_length(self.poses), np.ptp(self.stamps) if len(self.stamps) else 0.0
        return f"Trajectory({len(self.stamps)} poses, {length:.1f} m, {duration:.1f} s)"


# Seconds. Logs and relation files print stamps with few decimals, so equal times differ by rounding.
STAMP_TOLERANCE = 1e-6


def interpolate_poses(
    stamps: Float64[np.ndarray, "M"], poses: Float64[np.ndarray, "M 3"], query: Float64[np.ndarray, "Q"]
) -> Float64[np.ndarray, "Q 3"]:
    """Interpolate a trajectory at other times: linear in x and y, along the shorter arc in theta.

    Args:
        stamps: `[M]` seconds, not decreasing, M ≥ 1.
        poses: `[M, 3]` the trajectory.
        query: `[Q]` seconds. Outside the stamps, the first or last pose is held.

    Returns:
        `[Q, 3]` poses in the same frame.

    Raises:
        ValueError: the trajectory is empty or its stamps decrease.

    Example:
        Halfway between headings 3 and −3 rad the heading is −π (through ±π), not 0.
    """
    if stamps.size == 0:
        raise ValueError("cannot interpolate an empty trajectory: it has no poses")
    if np.any(np.diff(stamps) < 0):
        row = int(np.flatnonzero(np.diff(stamps) < 0)[0]) + 1
        raise ValueError(f"stamps decrease at row {row} ({stamps[row]!r}): sort the trajectory")
    headings = np.unwrap(poses[:, 2])
    x, y, theta = (np.interp(query, stamps, track) for track in (poses[:, 0], poses[:, 1], headings))
    return np.stack([x, y, se2.wrap(theta)], axis=-1)


def dead_reckon(
    times: Float64[np.ndarray, "Q"],
    stamps: Float64[np.ndarray, "S"],
    poses: Float64[np.ndarray, "S 3"],
    odometry_stamps: Float64[np.ndarray, "K"],
    odometry_poses: Float64[np.ndarray, "K 3"],
) -> Float64[np.ndarray, "Q 3"]:
    """Return poses at other times: the last pose at or before each time, plus the odometry since then.

    Args:
        times: `[Q]` seconds; before the first stamp the first pose is returned.
        stamps: `[S]` seconds, not decreasing, S ≥ 1.
        poses: `[S, 3]` the trajectory, any frame.
        odometry_stamps: `[K]` seconds, not decreasing, K ≥ 1.
        odometry_poses: `[K, 3]` integrated odometry in its own frame; constant beyond its ends.

    Example:
        Pose (5, 0, 0) at 1 s, odometry at 0.5 m/s along x: (5.25, 0, 0) at 1.5 s.
    """
    last = np.maximum(np.searchsorted(stamps, times + STAMP_TOLERANCE, side="right") - 1, 0)
    since = interpolate_poses(odometry_stamps, odometry_poses, stamps[last])
    now = interpolate_poses(odometry_stamps, odometry_poses, np.maximum(times, stamps[last]))
    return se2.compose(poses[last], se2.relative(since, now))


def path_length(poses: Float64[np.ndarray, "M 3"]) -> float:
    """Return the length of the polyline through the positions, meters."""
    return float(np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1).sum())


def net_rotation(poses: Float64[np.ndarray, "M 3"]) -> float:
    """Return the heading change from the first to the last pose with full turns counted, radians."""
    return float(se2.wrap(np.diff(poses[:, 2])).sum())


def yaw_from_quaternion(quaternions: Float64[np.ndarray, "*batch 4"]) -> Float64[np.ndarray, "*batch"]:
    """Return the yaw in radians of quaternions `[..., 4]` in the order x, y, z, w; any non-zero norm.

    The result is the heading of the rotated x axis in the plane, which is the yaw of the ZYX Euler angles.
    """
    x, y, z, w = (quaternions[..., axis] for axis in range(4))
    return np.arctan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z)


def interpolate_along_odometry(
    odometry: Float64[np.ndarray, "S 3"], rows: Int[np.ndarray, "T"], poses: Float64[np.ndarray, "T 3"]
) -> Float64[np.ndarray, "S 3"]:
    """Return a pose for every odometry pose, given the estimated poses at some of them.

    Between two estimates, odometry is integrated forward from the earlier one and backward from the later
    one, and the two results are blended in proportion to the motion so far. Before the first and after the
    last estimate only one of the two exists. The later estimate is required, so this suits finished runs.

    Args:
        odometry: `[S, 3]` integrated odometry in its own frame (m, m, rad).
        rows: `[T]` indices of the odometry poses that have an estimate, increasing, T ≥ 1.
        poses: `[T, 3]` the estimates, world frame.

    Returns:
        `[S, 3]` poses in the world frame, equal to `poses` at `rows`.

    Example:
        Odometry at x = 0, 1, 2 and estimates x = 0 and 2.2 at its ends give x = 1.1 in the middle.
    """
    steps = se2.relative(odometry[:-1], odometry[1:])
    # A radian counts like a meter: only the fraction of the motion matters, not its length.
    moved = np.concatenate([[0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]) + np.abs(steps[:, 2]))])
    row = np.arange(len(odometry))
    earlier = np.clip(np.searchsorted(rows, row, side="right") - 1, 0, len(rows) - 1)
    later = np.minimum(earlier + (row > rows[earlier]), len(rows) - 1)
    onward = se2.compose(poses[earlier], se2.relative(odometry[rows[earlier]], odometry))
    back = se2.compose(poses[later], se2.relative(odometry[rows[later]], odometry))
    way = moved[rows[later]] - moved[rows[earlier]]
    share = np.clip((moved - moved[rows[earlier]]) / np.where(way > 0.0, way, 1.0), 0.0, 1.0)
    gap = back - onward
    gap[:, 2] = se2.wrap(gap[:, 2])
    through = onward + share[:, None] * gap
    through[:, 2] = se2.wrap(through[:, 2])
    through[rows] = poses
    return through
