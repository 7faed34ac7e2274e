"""Exact ray casting on line segments."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxslam.sim.worlds.world import World


def cast_scan(
    world: World, pose_world_lidar: Float[Array, "3"], angles: Float[Array, "B"]
) -> Float[Array, "B"]:
    """Return the distance to the nearest segment along each ray from one pose.

    A segment is hit if its end points lie on opposite sides of the ray. Two segments that share a corner
    compute the same number for it, so no ray passes between them.

    Args:
        world: the segments, `[S, 4]` meters.
        pose_world_lidar: `[3]` start of the rays: m, m, rad.
        angles: `[B]` directions in the lidar frame, radians.

    Returns:
        `[B]` meters; infinity if a ray hits no segment. Accurate to about 1e-6 of the distance to
        the ends of the segment (float32).

    Example:
        From the middle of a 4 × 2 m room, the rays at 0 and π/2 measure 2 and 1.
    """
    directions = pose_world_lidar[2] + angles
    cos, sin = jnp.cos(directions)[:, None], jnp.sin(directions)[:, None]
    first = world.segments[:, :2] - pose_world_lidar[None, :2]
    second = world.segments[:, 2:] - pose_world_lidar[None, :2]
    along_first, side_first = _in_ray_frame(first, cos, sin)
    along_second, side_second = _in_ray_frame(second, cos, sin)

    crosses = (side_first >= 0) & (side_second <= 0) | (side_first <= 0) & (side_second >= 0)
    span = side_first - side_second
    in_line = span == 0
    fraction = side_first / jnp.where(in_line, 1.0, span)
    distance = along_first + fraction * (along_second - along_first)
    # For a segment in line with the ray: its nearer end, or 0 from within the segment.
    end_on = jnp.minimum(along_first, along_second)
    end_on = jnp.where(jnp.maximum(along_first, along_second) >= 0, jnp.maximum(end_on, 0.0), -1.0)
    distance = jnp.where(in_line, end_on, distance)
    return jnp.min(jnp.where(crosses & (distance >= 0), distance, jnp.inf), axis=1)


def cast_rays(
    world: World, poses_world_lidar: Float[Array, "T 3"], angles: Float[Array, "B"]
) -> Float[Array, "T B"]:
    """Apply `cast_scan` to poses `[T, 3]` in sequence, which limits memory to `B × S`."""
    return jax.lax.map(lambda pose: cast_scan(world, pose, angles), poses_world_lidar)


def _in_ray_frame(
    points: Float[Array, "S 2"], cos: Float[Array, "B 1"], sin: Float[Array, "B 1"]
) -> tuple[Float[Array, "B S"], Float[Array, "B S"]]:
    """Return the distances `[B, S]` of points along each ray and to its left, from the ray's origin."""
    x, y = points[None, :, 0], points[None, :, 1]
    return cos * x + sin * y, cos * y - sin * x
