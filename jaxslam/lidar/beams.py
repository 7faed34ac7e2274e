"""From ranges and bearings to points in the robot's base frame."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxslam.core import se2
from jaxslam.core.types import LidarScan
from jaxslam.lidar.normals import surface_normals
from jaxslam.xla.materialise import computed_once


class ScanPoints(eqx.Module):
    """Where the beams of one scan ended.

    Attributes:
        points: `[B, 2]` metres, base frame; the lidar's own position where a beam is not valid.
        valid: `[B]` whether the beam returned.
        normals: `[B, 2]` across the wall that was hit, of either sign; zero where that is not known.
    """

    points: Float[Array, "B 2"]
    valid: Bool[Array, "B"]
    normals: Float[Array, "B 2"]


def wall_jacobian(ends: ScanPoints, heading: Float[Array, ""]) -> Float[Array, "3 B"]:
    """How far each end point moves across its wall for a metre along x, along y, and a radian.

    Zero where no wall is known.

    Args:
        ends: the scan, base frame.
        heading: of the base in the world, radians; x and y are the world's.
    """
    arms, normals = se2.rotate_all(heading, ends.points), se2.rotate_all(heading, ends.normals)
    lever = arms[:, 0] * normals[:, 1] - arms[:, 1] * normals[:, 0]
    return jnp.stack([normals[:, 0], normals[:, 1], lever])


def scan_points(scan: LidarScan, max_beams: int | None = None) -> ScanPoints:
    """End points of a scan's beams, and the normals of what they hit, in the base frame.

    Args:
        scan: ranges `[B]` in metres and mask `[B]`.
        max_beams: at most this many beams, evenly spread over the scan; None keeps all.
    """
    angles, ranges, valid = scan.angles(), scan.ranges, scan.valid
    if max_beams is not None and max_beams < scan.num_beams:
        chosen = spread_beams(scan.num_beams, max_beams)
        angles, ranges, valid = angles[chosen], ranges[chosen], valid[chosen]
    ranges = jnp.where(valid, ranges, 0.0)

    def place(polar: tuple[Array, Array]) -> Float[Array, "B 2"]:
        angle, reach = polar
        points_lidar = jnp.stack([reach * jnp.cos(angle), reach * jnp.sin(angle)], axis=-1)
        return se2.apply(scan.pose_base_lidar, points_lidar)

    # Once per scan, not once per particle; and a point not once for each of its neighbours' normals.
    points = computed_once(place, (angles, ranges))
    normals = computed_once(lambda ends: surface_normals(*ends), (points, valid))
    return ScanPoints(points, valid, normals)


def spread_beams(num_beams: int, max_beams: int) -> Int[np.ndarray, "chosen"]:
    """Ascending indices of at most `max_beams` of `num_beams` beams, evenly spread, the ends included.

    Example:
        `spread_beams(5, 3)` is `[0, 2, 4]`, and `spread_beams(3, 5)` is `[0, 1, 2]`.
    """
    # Whole strides would throw away up to half of what is allowed.
    return np.round(np.linspace(0, num_beams - 1, min(max_beams, num_beams))).astype(np.int32)
