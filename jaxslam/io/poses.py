"""SE(2) on the host: the same operations as `jaxslam.se2`, in NumPy and float64.

Logs, references and metrics work on stamps and long trajectories outside of JAX; float32 would lose
centimetres on a map in UTM coordinates. Poses are `[..., 3]` = (x m, y m, theta rad); angles that
come back lie in [−π, π). Leading axes broadcast.
"""

import numpy as np
from jaxtyping import Float64, Int

# Logs and relation files print stamps with few decimals, so equal times differ by rounding, seconds.
STAMP_TOLERANCE = 1e-6


def wrap_angle(angle: Float64[np.ndarray, "*batch"] | float) -> Float64[np.ndarray, "*batch"]:
    """Wraps angles in radians, an array or one number, into [−π, π)."""
    wrapped = np.asarray(np.mod(angle + np.pi, 2 * np.pi) - np.pi)
    # Rounding can carry a tiny negative angle to exactly +π; the interval is half-open.
    return np.where(wrapped >= np.pi, -np.pi, wrapped)


def compose_poses(
    pose_a_b: Float64[np.ndarray, "*#batch 3"], pose_b_c: Float64[np.ndarray, "*#batch 3"]
) -> Float64[np.ndarray, "*batch 3"]:
    """Pose of `c` in `a` from the pose of `b` in `a` and of `c` in `b`.

    Example:
        `compose_poses([1, 0, π/2], [2, 0, 0])` is `[1, 2, π/2]`.
    """
    cos, sin = np.cos(pose_a_b[..., 2]), np.sin(pose_a_b[..., 2])
    x = pose_a_b[..., 0] + cos * pose_b_c[..., 0] - sin * pose_b_c[..., 1]
    y = pose_a_b[..., 1] + sin * pose_b_c[..., 0] + cos * pose_b_c[..., 1]
    return np.stack([x, y, wrap_angle(pose_a_b[..., 2] + pose_b_c[..., 2])], axis=-1)


def invert_poses(pose_a_b: Float64[np.ndarray, "*batch 3"]) -> Float64[np.ndarray, "*batch 3"]:
    """Pose of `a` in `b`."""
    cos, sin = np.cos(pose_a_b[..., 2]), np.sin(pose_a_b[..., 2])
    x = -cos * pose_a_b[..., 0] - sin * pose_a_b[..., 1]
    y = sin * pose_a_b[..., 0] - cos * pose_a_b[..., 1]
    return np.stack([x, y, wrap_angle(-pose_a_b[..., 2])], axis=-1)


def relative_poses(
    pose_a_b: Float64[np.ndarray, "*#batch 3"], pose_a_c: Float64[np.ndarray, "*#batch 3"]
) -> Float64[np.ndarray, "*batch 3"]:
    """Pose of `c` in `b`, both given in `a` (`c ⊖ b`)."""
    cos, sin = np.cos(pose_a_b[..., 2]), np.sin(pose_a_b[..., 2])
    dx, dy = pose_a_c[..., 0] - pose_a_b[..., 0], pose_a_c[..., 1] - pose_a_b[..., 1]
    theta = wrap_angle(pose_a_c[..., 2] - pose_a_b[..., 2])
    return np.stack([cos * dx + sin * dy, -sin * dx + cos * dy, theta], axis=-1)


def interpolate_poses(
    stamps: Float64[np.ndarray, "M"],
    poses: Float64[np.ndarray, "M 3"],
    query: Float64[np.ndarray, "Q"],
) -> Float64[np.ndarray, "Q 3"]:
    """Poses of a trajectory at other times: linear in x and y, along the shorter arc in theta.

    Args:
        stamps: `[M]` seconds, not decreasing, M ≥ 1.
        poses: `[M, 3]` the trajectory.
        query: `[Q]` seconds. Before the first and after the last stamp the end pose is held.

    Returns:
        `[Q, 3]` poses in the same frame.

    Raises:
        ValueError: an empty trajectory, or stamps that decrease.

    Example:
        Between headings 3 and −3 rad the middle is −π (through ±π), not 0.
    """
    if stamps.size == 0:
        raise ValueError("cannot interpolate an empty trajectory: it has no poses")
    if np.any(np.diff(stamps) < 0):
        row = int(np.flatnonzero(np.diff(stamps) < 0)[0]) + 1
        raise ValueError(f"stamps decrease at row {row} ({stamps[row]!r}): sort the trajectory")
    headings = np.unwrap(poses[:, 2])
    x, y, theta = (np.interp(query, stamps, track) for track in (poses[:, 0], poses[:, 1], headings))
    return np.stack([x, y, wrap_angle(theta)], axis=-1)


def carry_on(
    times: Float64[np.ndarray, "Q"],
    stamps: Float64[np.ndarray, "S"],
    poses: Float64[np.ndarray, "S 3"],
    odometry_stamps: Float64[np.ndarray, "K"],
    odometry_poses: Float64[np.ndarray, "K 3"],
) -> Float64[np.ndarray, "Q 3"]:
    """Poses at other times: the last pose at or before each, moved on by the odometry since.

    Args:
        times: `[Q]` seconds; the first pose is held before its stamp.
        stamps: `[S]` seconds, not decreasing, S ≥ 1.
        poses: `[S, 3]` the trajectory, any frame.
        odometry_stamps: `[K]` seconds, not decreasing, K ≥ 1.
        odometry_poses: `[K, 3]` integrated odometry in its own frame; held beyond its ends.

    Example:
        Pose (5, 0, 0) at 1 s, odometry at 0.5 m/s along x: (5.25, 0, 0) at 1.5 s.
    """
    last = np.maximum(np.searchsorted(stamps, times + STAMP_TOLERANCE, side="right") - 1, 0)
    since = interpolate_poses(odometry_stamps, odometry_poses, stamps[last])
    now = interpolate_poses(odometry_stamps, odometry_poses, np.maximum(times, stamps[last]))
    return compose_poses(poses[last], relative_poses(since, now))


def path_length(poses: Float64[np.ndarray, "M 3"]) -> float:
    """Length of the polyline through the positions, metres."""
    return float(np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1).sum())


def net_rotation(poses: Float64[np.ndarray, "M 3"]) -> float:
    """Heading change from the first to the last pose with full turns counted, radians."""
    return float(wrap_angle(np.diff(poses[:, 2])).sum())


def yaw_from_quaternion(
    quaternions: Float64[np.ndarray, "*batch 4"],
) -> Float64[np.ndarray, "*batch"]:
    """Yaw in radians of quaternions `[..., 4]` in the order x, y, z, w; any non-zero norm.

    The heading of the rotated x axis in the plane, which is the yaw of the ZYX Euler angles.
    """
    x, y, z, w = (quaternions[..., axis] for axis in range(4))
    return np.arctan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z)


def poses_along(
    odometry: Float64[np.ndarray, "S 3"], rows: Int[np.ndarray, "T"], poses: Float64[np.ndarray, "T 3"]
) -> Float64[np.ndarray, "S 3"]:
    """A pose for every odometry pose from those known at some of them.

    Between two known poses odometry carries the first on and the second back, and the way in between
    leads over from the one to the other as the robot moves; before the first and after the last there is
    only one of them. That needs the later pose, so it is for the path of a finished run.

    Args:
        odometry: `[S, 3]` integrated odometry in its own frame (m, m, rad).
        rows: `[T]` which of them are known, increasing, T ≥ 1.
        poses: `[T, 3]` the known ones, world frame.

    Returns:
        `[S, 3]` poses in the world frame; `poses` at `rows`.

    Example:
        Odometry at x = 0, 1, 2, known poses x = 0 and 2.2 at its ends: 1.1 in the middle.
    """
    steps = relative_poses(odometry[:-1], odometry[1:])
    # A radian counts like a metre: it is which share of the way was gone that matters, not its length.
    moved = np.concatenate([[0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]) + np.abs(steps[:, 2]))])
    row = np.arange(len(odometry))
    earlier = np.clip(np.searchsorted(rows, row, side="right") - 1, 0, len(rows) - 1)
    later = np.minimum(earlier + (row > rows[earlier]), len(rows) - 1)
    onward = compose_poses(poses[earlier], relative_poses(odometry[rows[earlier]], odometry))
    back = compose_poses(poses[later], relative_poses(odometry[rows[later]], odometry))
    way = moved[rows[later]] - moved[rows[earlier]]
    share = np.clip((moved - moved[rows[earlier]]) / np.where(way > 0.0, way, 1.0), 0.0, 1.0)
    gap = back - onward
    gap[:, 2] = wrap_angle(gap[:, 2])
    through = onward + share[:, None] * gap
    through[:, 2] = wrap_angle(through[:, 2])
    through[rows] = poses
    return through
