"""Static transforms of a robot: the mounting of a sensor, from the tree of `/tf_static`."""

from collections.abc import Iterable, Mapping
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float64

Tree = Mapping[str, tuple[str, Float64[np.ndarray, "4 4"]]]
"""Parent frame and pose of the child in it, by child frame."""

# Tilt at which a lidar no longer measures in the plane of the map.
TILT_WARNING = np.deg2rad(5.0)


xyz = attrgetter("x", "y", "z")
xyzw = attrgetter("x", "y", "z", "w")


def transform_matrix(transform: Any) -> Float64[np.ndarray, "4 4"] | None:
    """Return the homogeneous matrix of a `geometry_msgs/Transform`, None if it is not a rigid motion."""
    from scipy.spatial.transform import Rotation  # Slow to import, and only bags need it.

    translation, quaternion = np.array(xyz(transform.translation)), np.array(xyzw(transform.rotation))
    norm = np.linalg.norm(quaternion)
    if not np.isfinite(translation).all() or not np.isfinite(norm) or norm < 1e-6:
        return None
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
    matrix[:3, 3] = translation
    return matrix


def find_pose(parents: Tree, base_frames: Iterable[str], frame: str) -> Float64[np.ndarray, "4 4"] | None:
    """Return the pose `[4, 4]` of `frame` in the first base frame connected to it, or None."""
    if not frame:
        return None
    root, pose_root = _pose_in_root(parents, frame)
    for base_frame in base_frames:
        base_root, pose_root_base = _pose_in_root(parents, base_frame)
        if base_root == root:
            return np.linalg.solve(pose_root_base, pose_root)
    return None


def _pose_in_root(parents: Tree, frame: str) -> tuple[str, Float64[np.ndarray, "4 4"]]:
    pose = np.eye(4)
    visited = {frame}
    while frame in parents:
        frame, pose_parent_child = parents[frame]
        pose = pose_parent_child @ pose
        if frame in visited:  # A loop is not a tree; stop where it closes.
            break
        visited.add(frame)
    return frame, pose


class PlanarMounting(NamedTuple):
    """A lidar's mounting in the plane.

    Attributes:
        pose: `[3]` pose of the lidar in the base frame (m, m, rad).
        upside_down: whether the scan is mirrored, so that beam angles change their sign.
        tilt: angle of the scan plane to the horizontal, radians in [0, π/2].
    """

    pose: Float64[np.ndarray, "3"]
    upside_down: bool
    tilt: float


def planar_mounting(pose_base_lidar: Float64[np.ndarray, "4 4"]) -> PlanarMounting:
    """Project a lidar's mounting onto the plane.

    If the lidar's z axis points down, a beam at angle a in the lidar frame points at yaw − a in the base
    frame. So the angles must be negated, and the heading is that of the lidar's x axis.

    Example:
        Roll π at x = 0.1 m gives the pose (0.1, 0, 0), upside down, no tilt.
    """
    rotation = pose_base_lidar[:3, :3]
    yaw = np.arctan2(rotation[1, 0], rotation[0, 0])
    pose = np.array([pose_base_lidar[0, 3], pose_base_lidar[1, 3], yaw])
    tilt = float(np.arccos(np.clip(abs(rotation[2, 2]), 0.0, 1.0)))
    return PlanarMounting(pose, bool(rotation[2, 2] < 0), tilt)
