"""Normals of the walls in a scan, from neighboring end points."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

_REACH = 4
"""Neighbors considered on either side."""
_NEAR = 0.3
"""Neighbors within this distance are taken to be on the same wall, meters."""
_LONGEST_GAP = 1.5
"""An adjacent neighbor beyond `_NEAR`, as on a far wall, counts if both gaps are below this, meters."""
_LARGEST_RATIO = 2.0
"""The two gaps must also differ by less than this factor: a jump in depth is not a wall."""
_FLATNESS = 0.1
"""Largest spread across a wall, as a fraction of the spread along it."""


def surface_normals(points: Float[Array, "B 2"], valid: Bool[Array, "B"]) -> Float[Array, "B 2"]:
    """Return the unit normal of the wall at each end point, either sign.

    The normal is the minor principal axis of the point's neighborhood.

    Args:
        points: `[B, 2]` meters, in the order of the beams.
        valid: `[B]` which points are returns.

    Returns:
        `[B, 2]`; zero where the neighborhood has fewer than three points or is not flat.
    """
    num_beams = points.shape[0]
    step = points[1:] - points[:-1]
    gap = jnp.where(valid[1:] & valid[:-1], jnp.hypot(step[:, 0], step[:, 1]), jnp.inf)
    before = jnp.pad(gap, (1, 0), constant_values=jnp.inf)
    after = jnp.pad(gap, (0, 1), constant_values=jnp.inf)
    shorter, longer = jnp.minimum(before, after), jnp.maximum(before, after)
    far_wall = (longer < _LARGEST_RATIO * shorter) & (longer < _LONGEST_GAP)

    offset = np.arange(-_REACH, _REACH + 1)[:, None]
    neighbor = np.arange(num_beams)[None, :] + offset
    inside = (neighbor >= 0) & (neighbor < num_beams)
    index = np.clip(neighbor, 0, num_beams - 1)
    across, up = jnp.moveaxis(points[index] - points[None], -1, 0)
    near = across * across + up * up < _NEAR * _NEAR
    near = near | ((np.abs(offset) == 1) & far_wall[None])
    weight = (inside & valid[None] & valid[index] & near).astype(jnp.float32)
    products = jnp.stack([jnp.ones_like(across), across, up, across * across, across * up, up * up])
    count, x, y, xx, xy, yy = jnp.sum(weight[None] * products, axis=1)

    mean_x, mean_y = x / jnp.maximum(count, 1.0), y / jnp.maximum(count, 1.0)
    xx, xy, yy = xx - x * mean_x, xy - x * mean_y, yy - y * mean_y
    # Half the sum and half the difference of the eigenvalues.
    half_sum, half_difference = 0.5 * (xx + yy), jnp.hypot(0.5 * (xx - yy), xy)
    smaller, larger = half_sum - half_difference, half_sum + half_difference
    flat = (count >= 3) & (smaller < _FLATNESS * _FLATNESS * larger)
    along = 0.5 * jnp.arctan2(2 * xy, xx - yy)
    normals = jnp.stack([-jnp.sin(along), jnp.cos(along)], axis=-1)
    return jnp.where(flat[:, None], normals, 0.0)
