"""Thinning of walls by non-maximum suppression."""

import jax.numpy as jnp
from jaxtyping import Array, Int8, Int16

from jaxslam.grid.occupancy import OccupancyModel
from jaxslam.xla.materialize import materialize

NEIGHBORS = 2
"""Distance within which a stronger cell suppresses a weaker one, cells along each axis."""
_FIXED = 64
"""Fixed-point units per 1 of the thinning ratio; 127 times this value fits 16 bits."""


def thin_walls(model: OccupancyModel, window: Int8[Array, "rows size"]) -> Int8[Array, "rows size"]:
    """Return the log-odds of a window, with −1 in cells suppressed by a much stronger neighbor.

    Range and pose noise spreads a wall over two or three cells, and some grazing beams hit cells in front of
    it. All of these cells have positive log-odds, but after many scans the cells of the wall itself have many
    times more. Where all evidence is weak, as on a far wall seen once, no cell is suppressed.

    Args:
        model: its `thinning_ratio` is the fraction of the strongest neighbor's log-odds that a cell needs.
        window: `[rows, size]` fixed-point log-odds. Within `NEIGHBORS` columns of the sides, cells at the
            other end of an adjacent row may count as neighbors.
    """
    size = window.shape[1]
    cells = window.reshape(-1)
    # Without materialization, XLA recomputes the maximum along a row for every row of the neighborhood.
    along = materialize(lambda values: _strongest(values, 1), cells)

    def compare(values: tuple[Int8[Array, "n"], Int8[Array, "n"], Int16[Array, ""]]) -> Int8[Array, "n"]:
        cells, along, share = values
        strongest = _strongest(along, size).astype(jnp.int16)
        weak = (cells > 0) & (cells.astype(jnp.int16) * jnp.int16(_FIXED) < share * strongest)
        return jnp.where(weak, jnp.int8(-1), cells)

    share = jnp.round(jnp.clip(jnp.asarray(model.thinning_ratio), 0.0, 1.0) * _FIXED).astype(jnp.int16)
    return materialize(compare, (cells, along, share)).reshape(window.shape)


def _strongest(cells: Int8[Array, "n"], stride: int) -> Int8[Array, "n"]:
    """Return the maximum over each cell and its `NEIGHBORS` neighbors on either side, `stride` apart."""
    reach = NEIGHBORS * stride
    padded = jnp.pad(cells, (reach, reach), constant_values=jnp.int8(-128))
    result = cells
    for step in range(-NEIGHBORS, NEIGHBORS + 1):
        start = reach + step * stride
        result = jnp.maximum(result, padded[start : start + cells.shape[0]])
    return result
