"""Truncated distance transforms of occupancy grids."""

import jax.numpy as jnp
from jaxtyping import Array, Int8, UInt8

from jaxslam.xla.materialize import materialize

MAX_RADIUS = 10
"""Largest radius in cells for which sums of squares fit a byte: (r² + 1) + r² ≤ 255."""


def margin_rows(radius: int) -> int:
    """Return the number of rows above and below that `squared_distance_flat` reads but does not return."""
    return radius + 1


def squared_distance_flat(
    cells: Int8[Array, "H W"], occupied_above: Int8[Array, ""], radius: int
) -> UInt8[Array, "cells"]:
    """Return the squared Euclidean distance in cells² to the nearest occupied cell, at most `radius² + 1`.

    The method is a separable min-plus transform (lower envelope of parabolas), rows first, then columns. It
    takes `4 · radius` shifted reads of the flat array and compiles to a few vector instructions per cell.
    Within `radius` columns of the sides, a distance may refer to the other end of the neighboring row.

    Args:
        cells: `[H, W]`; cells over `occupied_above` are occupied. The first and last `margin_rows(radius)`
            rows are only read; the result omits them.
        occupied_above: the threshold.
        radius: truncation radius, cells (static).

    Example:
        With one occupied cell and `radius=2`: 0 in it, 1 beside it, 2 diagonally, 4 two cells away, else 5.
    """
    if not 1 <= radius <= MAX_RADIUS:
        raise ValueError(f"radius is {radius} cells: choose 1 to {MAX_RADIUS}")
    width = cells.shape[1]

    def seed(cells: tuple[Int8[Array, "H W"], Int8[Array, ""]]) -> UInt8[Array, "cells"]:
        values, occupied_above = cells
        far = jnp.uint8(radius * radius + 1)
        return jnp.where(values > occupied_above, jnp.uint8(0), far).reshape(-1)

    def along_rows(seeds: UInt8[Array, "cells"]) -> UInt8[Array, "rows"]:
        return _lower_envelope(seeds, seeds.shape[0] - 2 * width, radius, stride=1)

    def along_columns(rows: UInt8[Array, "rows"]) -> UInt8[Array, "cells"]:
        return _lower_envelope(rows, rows.shape[0] - 2 * radius * width, radius, stride=width)

    # Materialized: if fused, each stage would be recomputed for every shift of the next.
    seeds = materialize(seed, (cells, occupied_above))
    return materialize(along_columns, materialize(along_rows, seeds))


def _lower_envelope(values: UInt8[Array, "n"], size: int, radius: int, stride: int) -> UInt8[Array, "size"]:
    first = (values.shape[0] - size) // 2

    def shifted(cells: int) -> UInt8[Array, "size"]:
        start = first + cells * stride
        return values[start : start + size]

    result = shifted(0)
    for cells in range(1, radius + 1):
        nearer = jnp.minimum(shifted(-cells), shifted(cells))
        result = jnp.minimum(result, nearer + jnp.uint8(cells * cells))
    return jnp.minimum(result, jnp.uint8(radius * radius + 1))
