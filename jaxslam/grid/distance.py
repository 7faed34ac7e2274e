"""Truncated distance transforms of occupancy grids."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Int8, UInt8

from jaxslam.xla.materialize import materialize

MAX_RADIUS = 10
"""Largest radius in cells for which sums of squares fit a byte: (r² + 1) + r² ≤ 255."""


def squared_distance(occupied: Bool[Array, "H W"], radius: int) -> UInt8[Array, "H W"]:
    """Return the squared Euclidean distance in cells to the nearest occupied cell, at most `radius² + 1`.

    Example:
        With one occupied cell and `radius=2`: 0 in it, 1 beside it, 2 diagonally, 4 two cells away, else 5.
    """
    height, width = occupied.shape
    # Empty columns between the rows keep a shift of the flat array from reaching the neighboring row.
    padded = jnp.pad(occupied, ((margin_rows(radius),) * 2, (0, radius))).astype(jnp.int8)
    return squared_distance_flat(padded, jnp.int8(0), radius).reshape(height, width + radius)[:, :width]


def margin_rows(radius: int) -> int:
    """Return the number of rows above and below that `squared_distance_flat` reads but does not return."""
    return radius + 1


def squared_distance_flat(
    cells: Int8[Array, "H W"], occupied_above: Int8[Array, ""], radius: int
) -> UInt8[Array, "cells"]:
    """Return `squared_distance` as a flat array, at lower cost, wrong within `radius` columns of the sides.

    Near the sides a distance may refer to the other end of the neighboring row. The first and last
    `margin_rows(radius)` rows are only read; the result omits them. The whole transform is `4 · radius`
    shifted reads of flat arrays and compiles to a few vector instructions per cell.

    The method is a separable min-plus transform (lower envelope of parabolas), rows first, then columns.

    Args:
        cells: `[H, W]`; cells over `occupied_above` are occupied.
        occupied_above: the threshold.
        radius: truncation radius, cells (static).
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


def distance_to_nearest(occupied: Bool[Array, "H W"], reach: Int[Array, ""] | int) -> Float[Array, "H W"]:
    """Return the Euclidean distance in cells to the nearest occupied cell of a whole map, at most `reach`.

    Distances along the rows are computed first, then minimized over the rows within reach. This is cheap
    enough to run once per map, and `reach` may be any size.

    Args:
        occupied: `[H, W]`.
        reach: cells; may be traced.

    Example:
        With one occupied cell and `reach=5`: 0 in it, 1 beside it, 1.414 diagonally, 5 far away.
    """
    height, width = occupied.shape
    far = jnp.float32(height + width)
    column = jnp.broadcast_to(jnp.arange(width, dtype=jnp.float32)[None], (height, width))
    before = jax.lax.cummax(jnp.where(occupied, column, -far), axis=1)
    behind = jax.lax.cummin(jnp.where(occupied, column, 2.0 * far), axis=1, reverse=True)
    along = jnp.minimum(jnp.minimum(column - before, behind - column), far)
    squared = along * along

    def lower(rows: Int[Array, ""], nearest: Float[Array, "H W"]) -> Float[Array, "H W"]:
        away = rows.astype(jnp.float32)
        row = jnp.arange(height)[:, None]
        below = jnp.where(row >= rows, jnp.roll(squared, rows, axis=0), far * far)
        above = jnp.where(row < height - rows, jnp.roll(squared, -rows, axis=0), far * far)
        return jnp.minimum(nearest, jnp.minimum(below, above) + away * away)

    nearest = jax.lax.fori_loop(1, jnp.minimum(reach, height - 1) + 1, lower, squared)
    return jnp.minimum(jnp.sqrt(nearest), jnp.asarray(reach, jnp.float32))
