"""The field of a whole map, as localisation in a known map uses it."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxslam.grid.distance import margin_rows
from jaxslam.sensor.field import COARSE_FACTOR, COARSE_RADIUS, Field, prepare_field


def field_of_map(
    occupied: Bool[Array, "H W"],
    origin: Float[Array, "2"],
    resolution: Float[Array, ""],
    radius: int,
) -> Field:
    """Distance fields of a map of any size, right up to its edges and as far beyond as they reach.

    Free space is put around the map: `prepare_field` gives up some columns and rows at its sides, wants whole
    coarse cells, and a point just off the map is still near the map's last obstacle.

    Args:
        occupied: `[H, W]`, row 0 the lowest y.
        origin: `[2]` world position of the lower-left corner of cell (0, 0), metres.
        resolution: side of a cell, metres.
        radius: truncation radius, cells, 1 to 10 (static).

    Raises:
        ValueError: for a radius out of bounds.
    """
    height, width = occupied.shape
    # The coarse level reaches farther than the largest radius of the fine one.
    reach = COARSE_RADIUS * COARSE_FACTOR
    # Columns twice: those that are asked about, and those that `DistanceField` gives up.
    left, below = 2 * reach, reach
    right = left + -width % COARSE_FACTOR
    above = below + -height % COARSE_FACTOR
    margin = margin_rows(radius)
    padded = jnp.pad(occupied, ((below + margin, above + margin), (left, right)))
    # A complete map: no cell is unseen.
    log_odds = jnp.where(padded, jnp.int8(1), jnp.int8(-1))
    corner = origin - resolution * jnp.asarray([left, below + margin], jnp.float32)
    return prepare_field(log_odds, jnp.int8(0), corner, resolution, radius)
