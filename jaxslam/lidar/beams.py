"""Conversion of ranges and bearings to points in the robot's base frame."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxslam.core import se2
from jaxslam.core.types import LidarScan
from jaxslam.lidar.normals import surface_normals
from jaxslam.xla.materialize import materialize


class ScanPoints(eqx.Module):
    """The end points of one scan.

    Attributes:
        points: `[B, 2]` meters, base frame; the position of the lidar where a beam is not valid.
        valid: `[B]` whether the beam returned.
        normals: `[B, 2]` unit normals of the walls hit, either sign; zero where the normal is unknown.
    """

    points: Float[Array, "B 2"]
    valid: Bool[Array, "B"]
    normals: Float[Array, "B 2"]


def wall_jacobian(ends: ScanPoints, heading: Float[Array, ""]) -> Float[Array, "3 B"]:
    """Return how far each end point moves across its wall per meter along world x and y, and per radian.

    Entries are zero where the wall's normal is unknown. `heading` is that of the base in the world, radians.
    """
    arms, normals = se2.rotate(heading, ends.points), se2.rotate(heading, ends.normals)
    lever = arms[:, 0] * normals[:, 1] - arms[:, 1] * normals[:, 0]
    return jnp.stack([normals[:, 0], normals[:, 1], lever])


def scan_points(scan: LidarScan, max_beams: int | None = None) -> ScanPoints:
    """Return the end points of a scan's beams, and the normals of the walls they hit, in the base frame.

    At most `max_beams` beams are used, evenly spread over the scan; None keeps all.
    """
    angles, ranges, valid = _beams(scan, max_beams)
    # Materialized: XLA would repeat both for every particle, and each point for every neighbor's normal.
    points = materialize(lambda beams: _place(scan, *beams), (angles, ranges))
    normals = materialize(lambda ends: surface_normals(*ends), (points, valid))
    return ScanPoints(points, valid, normals)


def end_points(scan: LidarScan, max_beams: int | None = None) -> tuple[Float[Array, "B 2"], Bool[Array, "B"]]:
    """Return end points `[B, 2]` in the base frame, meters, and whether each beam `[B]` returned.

    The end point of a beam without a return is the position of the lidar. Arguments as for `scan_points`.
    """
    angles, ranges, valid = _beams(scan, max_beams)
    return _place(scan, angles, ranges), valid


def _beams(
    scan: LidarScan, max_beams: int | None
) -> tuple[Float[Array, "B"], Float[Array, "B"], Bool[Array, "B"]]:
    angles, ranges, valid = scan.angles(), scan.ranges, scan.valid
    if max_beams is not None and max_beams < scan.num_beams:
        chosen = spread_beams(scan.num_beams, max_beams)
        angles, ranges, valid = angles[chosen], ranges[chosen], valid[chosen]
    return angles, jnp.where(valid, ranges, 0.0), valid


def _place(scan: LidarScan, angles: Float[Array, "B"], ranges: Float[Array, "B"]) -> Float[Array, "B 2"]:
    points_lidar = jnp.stack([ranges * jnp.cos(angles), ranges * jnp.sin(angles)], axis=-1)
    return se2.apply(scan.pose_base_lidar, points_lidar)


def inlier_ratio(inliers: Bool[Array, "B"], valid: Bool[Array, "B"]) -> Float[Array, ""]:
    """Return the fraction of valid beams `[B]` that are inliers; 0 without a valid beam."""
    num_valid = jnp.sum(valid, dtype=jnp.float32)
    return jnp.sum(valid & inliers, dtype=jnp.float32) / jnp.maximum(num_valid, 1.0)


def spread_beams(num_beams: int, max_beams: int) -> Int[np.ndarray, "chosen"]:
    """Return ascending indices of at most `max_beams` of `num_beams` beams, evenly spread, with both ends.

    Example:
        `spread_beams(5, 3)` is `[0, 2, 4]`, and `spread_beams(3, 5)` is `[0, 1, 2]`.
    """
    # Whole strides would discard up to half of the allowed beams.
    return np.round(np.linspace(0, num_beams - 1, min(max_beams, num_beams))).astype(np.int32)
