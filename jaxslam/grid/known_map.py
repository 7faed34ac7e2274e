"""A given map: its obstacles, the distance of each cell to them, and its free cells."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from jaxslam.core import se2
from jaxslam.grid.cell_table import BORDER, CellTable
from jaxslam.grid.distance import MAX_RADIUS
from jaxslam.grid.field import Field, field_of_map
from jaxslam.io.map_server import OccupancyMap


class KnownMap(eqx.Module):
    """A map to localize in, created once by `from_map`.

    Its cells are aligned with the map frame, which `origin` places in the world, rotated or not.

    Attributes:
        occupied: `[H, W]`, row 0 the lowest y of the map frame.
        distance: `[H + 2, W + 2]` distance between the centers of a cell and of the nearest obstacle, meters,
            at most `max_distance`; includes a border of one cell at `max_distance`.
        free: `[M]` row-major indices of the free cells, where a robot can stand, ascending.
        resolution: side of a cell, meters.
        origin: `[3]` pose of the outer corner of cell (0, 0) in the world (m, m, rad).
        max_distance: truncation distance, meters.
    """

    occupied: Bool[Array, "H W"]
    distance: Float[Array, "height width"]
    free: Int[Array, "M"]
    resolution: Float[Array, ""]
    origin: Float[Array, "3"]
    max_distance: Float[Array, ""]

    @classmethod
    def from_map(cls, occupancy: OccupancyMap, max_distance: float = 2.0) -> "KnownMap":
        """Compute the distances and the free cells of a map.

        Args:
            occupancy: the map, as returned by `jaxslam.io.read_map`.
            max_distance: truncation: end points farther than this from any obstacle score alike, meters.

        Raises:
            ValueError: the map has no obstacle or no free space.
        """
        from scipy.ndimage import distance_transform_edt  # Slow to import, and only known maps need it.

        height, width = occupancy.occupied.shape
        required = {
            "occupied": (occupancy.occupied, "no scan can be matched to it"),
            "free": (occupancy.free, "there is no place for the robot"),
        }
        for kind, (cells, consequence) in required.items():
            if not cells.any():
                raise ValueError(
                    f"{occupancy.name}: no {kind} cell among its {width} × {height} cells, so {consequence}: "
                    "check its thresholds and negate"
                )
        distance = distance_transform_edt(~occupancy.occupied).astype(np.float32)
        distance = np.minimum(distance * np.float32(occupancy.resolution), np.float32(max_distance))
        return cls(
            occupied=jnp.asarray(occupancy.occupied),
            distance=jnp.pad(jnp.asarray(distance), BORDER, constant_values=jnp.float32(max_distance)),
            free=jnp.asarray(np.flatnonzero(occupancy.free), jnp.int32),
            resolution=jnp.asarray(occupancy.resolution, jnp.float32),
            origin=jnp.asarray(occupancy.origin, jnp.float32),
            max_distance=jnp.asarray(max_distance, jnp.float32),
        )

    @property
    def shape(self) -> tuple[int, int]:
        """Return rows and columns, without the border."""
        height, width = self.occupied.shape
        return height, width

    def draw_free(self, key: PRNGKeyArray, count: int) -> Float[Array, "count 3"]:
        """Draw poses `[count, 3]` (m, m, rad, world frame), uniform over the free space and all headings."""
        key_cell, key_within, key_heading = jax.random.split(key, 3)
        chosen = self.free[jax.random.randint(key_cell, (count,), 0, self.free.shape[0])]
        cells = jnp.stack([chosen % self.shape[1], chosen // self.shape[1]], axis=-1).astype(jnp.float32)
        points = (cells + jax.random.uniform(key_within, (count, 2), jnp.float32)) * self.resolution
        heading = jax.random.uniform(key_heading, (count, 1), jnp.float32, -jnp.pi, jnp.pi)
        return jax.vmap(se2.compose, (None, 0))(self.origin, jnp.concatenate([points, heading], axis=-1))

    def to_map(self, poses: Float[Array, "N 3"]) -> Float[Array, "N 3"]:
        """Return world poses `[N, 3]` in the map frame (m, m, rad)."""
        return jax.vmap(se2.relative, (None, 0))(self.origin, poses)

    def to_cells(self, poses: Float[Array, "N 3"]) -> Float[Array, "N 3"]:
        """Return world poses `[N, 3]` as unrounded column, unrounded row and heading in the map (rad)."""
        local = self.to_map(poses)
        return jnp.concatenate([local[:, :2] / self.resolution, local[:, 2:]], axis=-1)

    def field(self) -> Field:
        """Return the distance fields of the whole map, in the map frame."""
        return field_of_map(self.occupied, jnp.zeros(2, jnp.float32), self.resolution, MAX_RADIUS)

    def table(self, values: Float[Array, "height width"]) -> CellTable:
        """Return the table of `values`, one per cell, in the shape of `distance`."""
        height, width = self.shape
        return CellTable(values.reshape(-1), self.resolution, height, width)

    def hits(self, sigma: float | Float[Array, ""]) -> Float[Array, "height width"]:
        """Return exp(−d²/2σ²) of each cell, σ in meters; 0 where the distance is truncated."""
        hit = jnp.exp(-0.5 * (self.distance / sigma) ** 2)
        return jnp.where(self.distance < self.max_distance, hit, 0.0)

    def near_obstacles(self, near: float | Float[Array, ""]) -> CellTable:
        """Return a table with 1 in the cells within `near` meters of an obstacle, and 0 elsewhere."""
        # `distance` is truncated at `max_distance`, which represents every larger distance.
        return self.table((self.distance < jnp.minimum(near, self.max_distance)).astype(jnp.float32))

    def is_free(self, pose: Float[Array, "3"]) -> Bool[Array, ""]:
        """Return whether a pose `[3]` (world frame) lies in a free cell of the map."""
        column, row = jnp.floor(self.to_cells(pose[None])[0, :2]).astype(jnp.int32)
        inside = (column >= 0) & (column < self.shape[1]) & (row >= 0) & (row < self.shape[0])
        return inside & jnp.any(self.free == row * self.shape[1] + column)
