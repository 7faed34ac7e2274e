"""Size and placement of a grid in the world."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


class GridSpec(eqx.Module):
    """Size and placement of a grid map. Row 0 is the lowest y, column 0 the lowest x.

    Attributes:
        height: rows `H` (static).
        width: columns `W` (static).
        resolution: side of a cell, meters.
        origin: `[2]` world position of the lower-left corner of cell (0, 0), meters.
    """

    resolution: Float[Array, ""]
    origin: Float[Array, "2"]
    height: int = eqx.field(static=True)
    width: int = eqx.field(static=True)

    @classmethod
    def covering(
        cls, lower: Float[np.ndarray, "2"], upper: Float[np.ndarray, "2"], resolution: float
    ) -> "GridSpec":
        """Return the smallest grid of whole cells that covers the box from `lower` to `upper` (meters)."""
        cells = np.maximum(np.ceil((np.asarray(upper) - lower) / resolution), 1).astype(int)
        return cls(
            resolution=jnp.asarray(resolution, jnp.float32),
            origin=jnp.asarray(lower, jnp.float32),
            height=int(cells[1]),
            width=int(cells[0]),
        )

    def cells(self, points: Float[Array, "*points 2"]) -> Float[Array, "*points 2"]:
        """Return points `[..., 2]` in continuous cells: (column, row), where cell (0, 0) spans [0, 1)²."""
        return (points - jnp.broadcast_to(self.origin, points.shape)) / self.resolution
