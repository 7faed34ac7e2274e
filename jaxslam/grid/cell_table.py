"""A table of one value per map cell, summed over a scan's end points at many poses at once."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

BORDER = 1
"""Width of the border around the map, cells; look-ups outside the map read it."""
_UNROLL = 5
"""Beams per loop iteration; more would exceed the CPU registers."""


class CellTable(eqx.Module):
    """Table of one value per cell of a map and its border of one cell, in row-major order.

    Attributes:
        values: `[(H + 2) · (W + 2)]`.
        resolution: side of a cell, meters.
        height: rows H of the map (static).
        width: columns W of the map (static).
    """

    values: Float[Array, "cells"]
    resolution: Float[Array, ""]
    height: int = eqx.field(static=True)
    width: int = eqx.field(static=True)

    def sum_over_beams(
        self, poses: Float[Array, "N 3"], points: Float[Array, "B 2"], weights: Float[Array, "B"]
    ) -> Float[Array, "N"]:
        """Return, for each pose, the weighted sum of the values at the end points of a scan.

        Args:
            poses: `[N, 3]` base poses in the frame of the map (m, m, rad).
            points: `[B, 2]` end points in the base frame, meters.
            weights: `[B]`; 0 omits a beam.
        """
        x, y, cos, sin = self._in_cells(poses)

        def add(total: Float[Array, "N"], beam: Float[Array, "3"]) -> tuple[Float[Array, "N"], None]:
            along, left, weight = beam
            return total + weight * self._at(x + cos * along - sin * left, y + sin * along + cos * left), None

        # Loop over beams, vectorized over particles: the CPU handles 8 or 16 particles per instruction.
        beams = jnp.concatenate([points / self.resolution, weights[:, None]], axis=-1)
        return jax.lax.scan(add, jnp.zeros_like(x), beams, unroll=_UNROLL)[0]

    def sum_over_poses(
        self, poses: Float[Array, "N 3"], points: Float[Array, "B 2"], weights: Float[Array, "N"]
    ) -> Float[Array, "B"]:
        """Return, for each beam, the weighted sum over the poses of the values at its end point.

        Args:
            poses: `[N, 3]` base poses in the frame of the map (m, m, rad).
            points: `[B, 2]` end points in the base frame, meters.
            weights: `[N]`, one per pose.
        """
        x, y, cos, sin = self._in_cells(poses)

        def total(point: Float[Array, "2"]) -> Float[Array, ""]:
            column, row = x + cos * point[0] - sin * point[1], y + sin * point[0] + cos * point[1]
            return jnp.sum(weights * self._at(column, row))

        return jax.lax.map(total, points / self.resolution)

    def _in_cells(self, poses: Float[Array, "N 3"]) -> tuple[Float[Array, "N"], ...]:
        """Return the unrounded column and row of the poses, and the cosine and sine of their headings."""
        border = np.float32(BORDER)
        x, y = poses[:, 0] / self.resolution + border, poses[:, 1] / self.resolution + border
        return x, y, jnp.cos(poses[:, 2]), jnp.sin(poses[:, 2])

    def _at(self, column: Float[Array, "N"], row: Float[Array, "N"]) -> Float[Array, "N"]:
        # Points outside the map and NaNs are moved to the border.
        column = jnp.where(column > 0.0, jnp.minimum(column, np.float32(self.width + BORDER)), 0.0)
        row = jnp.where(row > 0.0, jnp.minimum(row, np.float32(self.height + BORDER)), 0.0)
        index = row.astype(jnp.int32) * (self.width + 2 * BORDER) + column.astype(jnp.int32)
        return self.values.at[index].get(mode="promise_in_bounds", wrap_negative_indices=False)
