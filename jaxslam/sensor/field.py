"""The prepared map: distance to the nearest obstacle, at the map's resolution and coarser."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, UInt8

from jaxslam.grid.distance import margin_rows, squared_distance_flat

COARSE_FACTOR = 4
"""Cells of the map along one side of a coarse cell."""
COARSE_RADIUS = 5
"""Truncation radius of the coarse level, in coarse cells: 1 m at 5 cm cells."""


class DistanceField(eqx.Module):
    """Truncated squared distance to the nearest occupied cell, row after row.

    Attributes:
        squared_cells: `[height · width]` squared cells, at most `radius² + 1`.
        origin: `[2]` world position of the lower-left corner, metres.
        resolution: side of a cell, metres.
        height: rows (static).
        width: columns (static).
        radius: truncation radius in cells (static).
    """

    squared_cells: UInt8[Array, "cells"]
    origin: Float[Array, "2"]
    resolution: Float[Array, ""]
    height: int = eqx.field(static=True)
    width: int = eqx.field(static=True)
    radius: int = eqx.field(static=True)

    def squared_distance(self, points: Float[Array, "B 2"]) -> Float[Array, "B"]:
        """Squared distance in m² from the cells that hold the points; truncated off the field."""
        cells = jnp.floor((points - self.origin[None]) / self.resolution).astype(jnp.int32)
        column, row = cells[:, 0], cells[:, 1]
        side = self.radius
        inside = (column >= side) & (column < self.width - side) & (row >= 0) & (row < self.height)
        index = jnp.where(inside, row * self.width + column, 0)
        found = self.squared_cells.at[index].get(mode="promise_in_bounds").astype(jnp.float32)
        far = self.radius * self.radius + 1.0
        return jnp.where(inside, found, far) * self.resolution * self.resolution


class Field(eqx.Module):
    """A map window prepared for scoring and matching.

    Attributes:
        fine: distances at the map's own resolution.
        coarse: distances over `COARSE_FACTOR` times larger cells: a wider basin for the matcher.
    """

    fine: DistanceField
    coarse: DistanceField


def window_rows(size: int, radius: int) -> int:
    """Rows that a window of `size` columns must have to be prepared: the field's and its margins."""
    return size + 2 * _margin(radius)


def prepare_field(
    occupied: Bool[Array, "rows size"],
    origin: Float[Array, "2"],
    resolution: Float[Array, ""],
    radius: int,
) -> Field:
    """Distance fields of a window of `window_rows` rows whose lower-left corner is at `origin`."""
    rows, size = occupied.shape
    margin = _margin(radius)
    height = rows - 2 * margin
    fine = squared_distance_flat(
        occupied[margin - margin_rows(radius) : rows - margin + margin_rows(radius)], radius
    )
    coarse_rows, coarse_width = rows // COARSE_FACTOR, size // COARSE_FACTOR
    blocks = occupied.reshape(coarse_rows, COARSE_FACTOR, coarse_width, COARSE_FACTOR)
    coarse = squared_distance_flat(jnp.any(blocks, axis=(1, 3)), COARSE_RADIUS)
    lift = jnp.asarray([0.0, margin], jnp.float32) * resolution
    return Field(
        fine=DistanceField(fine, origin + lift, resolution, height, size, radius),
        coarse=DistanceField(
            coarse,
            origin + lift,
            resolution * COARSE_FACTOR,
            height // COARSE_FACTOR,
            coarse_width,
            COARSE_RADIUS,
        ),
    )


def _margin(radius: int) -> int:
    """Map rows of margin on either side that serve both levels."""
    return max(margin_rows(COARSE_RADIUS) * COARSE_FACTOR, margin_rows(radius))
