"""From ranges and bearings to points in the robot's base frame."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxslam import se2
from jaxslam.lidar.subset import spread_beams
from jaxslam.once import computed_once
from jaxslam.types import LidarScan


class ScanPoints(eqx.Module):
    """Where the beams of one scan ended.

    Attributes:
        points: `[B, 2]` metres, base frame; the lidar's own position where a beam is not valid.
        valid: `[B]` whether the beam returned.
    """

    points: Float[Array, "B 2"]
    valid: Bool[Array, "B"]
    normals: Float[Array, "B 2"]


def scan_points(scan: LidarScan, max_beams: int | None = None) -> ScanPoints:
    """End points of a scan's beams in the base frame.

    Args:
        scan: ranges `[B]` in metres and mask `[B]`.
        max_beams: at most this many beams, evenly spread over the scan; None keeps all.
    """
    angles, ranges, valid = scan.angles(), scan.ranges, scan.valid
    if max_beams is not None and max_beams < scan.num_beams:
        chosen = spread_beams(scan.num_beams, max_beams)
        angles, ranges, valid = angles[chosen], ranges[chosen], valid[chosen]
    ranges = jnp.where(valid, ranges, 0.0)

    def place(polar: tuple[Array, Array, Array]) -> Array:
        angle, reach, valid = polar
        points_lidar = jnp.stack([reach * jnp.cos(angle), reach * jnp.sin(angle)], axis=-1)
        points = se2.apply(scan.pose_base_lidar, points_lidar)
        return jnp.concatenate([points, surface_normals(points, valid)], axis=-1)

    # Once per scan, not once per particle.
    placed = computed_once(place, (angles, ranges, valid))
    return ScanPoints(placed[:, :2], valid, placed[:, 2:])


NEIGHBOURS = 4
NEAR = 0.3
FLAT = 0.1


def surface_normals(points, valid):
    """Direction across the wall at each end point"""
    offsets = [k for k in range(-NEIGHBOURS, NEIGHBOURS + 1)]
    num = points.shape[0]
    n = sx = sy = sxx = sxy = syy = 0.0
    for k in offsets:
        other = jnp.roll(points, -k, axis=0)
        index = jnp.arange(num) + k
        ok = jnp.roll(valid, -k) & (index >= 0) & (index < num) & valid
        d = other - points
        near = jnp.sum(d * d, axis=-1) < NEAR**2
        if abs(k) <= 1:
            near = near | True
        w = (ok & near).astype(jnp.float32)
        n, sx, sy = n + w, sx + w * d[:, 0], sy + w * d[:, 1]
        sxx, sxy, syy = sxx + w * d[:, 0] ** 2, sxy + w * d[:, 0] * d[:, 1], syy + w * d[:, 1] ** 2
    m = jnp.maximum(n, 1.0)
    cxx, cxy, cyy = sxx - sx * sx / m, sxy - sx * sy / m, syy - sy * sy / m
    half, root = 0.5 * (cxx + cyy), jnp.hypot(0.5 * (cxx - cyy), cxy)
    angle = 0.5 * jnp.arctan2(2 * cxy, cxx - cyy)
    flat = (n >= 3) & (half - root < FLAT**2 * (half + root))
    normals = jnp.stack([-jnp.sin(angle), jnp.cos(angle)], axis=-1)
    return jnp.where(flat[:, None], normals, 0.0)
