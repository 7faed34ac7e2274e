"""Thinning of walls: only cells that stand out from their neighbors are obstacles."""

import jax.numpy as jnp
from jaxtyping import Array, Int8, Int16

from jaxslam.grid.occupancy import OccupancyModel
from jaxslam.xla.materialize import materialize

NEIGHBORS = 2
"""Distance at which a stronger cell suppresses a weaker one, cells along each axis."""
_FIXED = 64
"""Denominator of the fixed-point ratio: 127 · 64 fits 16 bits."""


def thin_walls(model: OccupancyModel, window: Int8[Array, "rows size"]) -> Int8[Array, "rows size"]:
    """Return the log-odds of a window, with −1 in cells that a much stronger neighbor suppresses.

    Noise of ranges and poses smears a wall over two or three cells, and some beams that graze the wall end
    in cells in front of it. All of these cells are more likely occupied than not, but where the lidar has
    seen a wall often, the wall's own cells have many times their log-odds. Where all log-odds are low, as on
    a far wall seen once, no cell is suppressed.

    Args:
        model: its `thinning_ratio` is the share of the strongest neighbor's log-odds that a cell needs.
        window: `[rows, size]` log-odds in fixed point. Within `NEIGHBORS` columns of the sides, neighbors
            in the next row may count.
    """
    size = window.shape[1]
    cells = window.reshape(-1)
    # Materialized: if fused, the maximum along a row would be recomputed for every row of the square.
    along = materialize(lambda values: _strongest(values, 1), cells)

    def compare(values: tuple[Int8[Array, "n"], Int8[Array, "n"], Int16[Array, ""]]) -> Int8[Array, "n"]:
        cells, along, share = values
        strongest = _strongest(along, size).astype(jnp.int16)
        weak = (cells > 0) & (cells.astype(jnp.int16) * jnp.int16(_FIXED) < share * strongest)
        return jnp.where(weak, jnp.int8(-1), cells)

    share = jnp.round(jnp.clip(jnp.asarray(model.thinning_ratio), 0.0, 1.0) * _FIXED).astype(jnp.int16)
    return materialize(compare, (cells, along, share)).reshape(window.shape)


def _strongest(cells: Int8[Array, "n"], stride: int) -> Int8[Array, "n"]:
    """Return the largest of each cell and its neighbors on both sides, which lie `stride` cells apart."""
    reach = NEIGHBORS * stride
    padded = jnp.pad(cells, (reach, reach), constant_values=jnp.int8(-128))
    result = cells
    for step in range(-NEIGHBORS, NEIGHBORS + 1):
        start = reach + step * stride
        result = jnp.maximum(result, padded[start : start + cells.shape[0]])
    return result
