"""Which cells of a map are obstacles: those that stand out from their neighbors."""

import jax.numpy as jnp
from jaxtyping import Array, Int8, Int16

from jaxslam.grid.occupancy import OccupancyModel
from jaxslam.xla.materialize import materialize

NEIGHBORS = 2
"""How far a stronger cell takes the wall from a weaker one, cells along each axis."""
_FIXED = 64
"""Shares are counted in so many parts: 127 times as much fits 16 bits."""


def thin_walls(model: OccupancyModel, window: Int8[Array, "rows size"]) -> Int8[Array, "rows size"]:
    """The log-odds of a window, but −1 where a neighbor has so much more that the wall is there.

    Noise of ranges and poses smears a wall over two or three cells, and some of the beams that graze it hit
    cells before it. All of those are occupied more than not; but where the lidar has seen a wall often, the
    cells that hold it have many times their evidence. Where all evidence is weak, as on a far wall seen once,
    nothing is taken away.

    Args:
        model: its `thinning_ratio` is the share of the strongest neighbor's log-odds that a cell must have.
        window: `[rows, size]` log-odds in fixed point. Within `NEIGHBORS` columns of the sides, neighbors
            in the next row may count.
    """
    size = window.shape[1]
    cells = window.reshape(-1)
    # Each once: fused, the strongest of a row would be sought anew for every row of the square.
    along = materialize(lambda values: _strongest(values, 1), cells)

    def compare(values: tuple[Int8[Array, "n"], Int8[Array, "n"], Int16[Array, ""]]) -> Int8[Array, "n"]:
        cells, along, share = values
        strongest = _strongest(along, size).astype(jnp.int16)
        weak = (cells > 0) & (cells.astype(jnp.int16) * jnp.int16(_FIXED) < share * strongest)
        return jnp.where(weak, jnp.int8(-1), cells)

    share = jnp.round(jnp.clip(jnp.asarray(model.thinning_ratio), 0.0, 1.0) * _FIXED).astype(jnp.int16)
    return materialize(compare, (cells, along, share)).reshape(window.shape)


def _strongest(cells: Int8[Array, "n"], stride: int) -> Int8[Array, "n"]:
    """The largest of each cell and its neighbors so many cells apart."""
    reach = NEIGHBORS * stride
    padded = jnp.pad(cells, (reach, reach), constant_values=jnp.int8(-128))
    result = cells
    for step in range(-NEIGHBORS, NEIGHBORS + 1):
        start = reach + step * stride
        result = jnp.maximum(result, padded[start : start + cells.shape[0]])
    return result
