"""Distance fields of a map: distance to the nearest obstacle, at the map's resolution and coarser."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Int8, UInt8, UInt16

from jaxslam.core import se2
from jaxslam.grid.distance import margin_rows, squared_distance_flat
from jaxslam.lidar.beams import ScanPoints, inlier_ratio
from jaxslam.xla.materialize import materialize

COARSE_FACTOR = 4
"""Side of a coarse cell, in cells of the map."""
COARSE_RADIUS = 5
"""Truncation radius of the coarse level, in coarse cells: 1 m at 5 cm cells."""


class DistanceField(eqx.Module):
    """Truncated squared distance to the nearest occupied cell, in row-major order.

    Attributes:
        pairs: `[height · width]` squared cells, at most `radius² + 1`: each cell's distance in the low byte
            and its right neighbor's in the high byte, so that interpolation takes two look-ups instead of
            four. The highest bit of each byte marks a cell that has not been observed yet.
        origin: `[2]` world position of the lower-left corner, meters.
        resolution: side of a cell, meters.
        height: rows (static).
        width: columns (static).
        radius: truncation radius in cells (static).
    """

    pairs: UInt16[Array, "cells"]
    origin: Float[Array, "2"]
    resolution: Float[Array, ""]
    height: int = eqx.field(static=True)
    width: int = eqx.field(static=True)
    radius: int = eqx.field(static=True)

    def squared_distance(self, points: Float[Array, "B 2"]) -> Float[Array, "B"]:
        """Return the squared distance in m² at the points, by cell; off the field, the largest distance."""
        return self.look_up(points)[0]

    def centers(self, cells: Float[Array, "B 2"]) -> Float[Array, "B 2"]:
        """Return the centers of cells, given as whole (column, row), meters."""
        return (cells + 0.5) * self.resolution + self.origin[None, :]

    def look_up(self, points: Float[Array, "B 2"]) -> tuple[Float[Array, "B"], Bool[Array, "B"]]:
        """Return the squared distance in m² at the points, and which are unseen and far from obstacles."""
        scale = 1.0 / self.resolution
        column = jnp.floor((points[:, 0] - self.origin[0]) * scale).astype(jnp.int32)
        row = jnp.floor((points[:, 1] - self.origin[1]) * scale).astype(jnp.int32)
        side = self.radius
        inside = (column >= side) & (column < self.width - side) & (row >= 0) & (row < self.height)
        found = self._look_up(jnp.where(inside, row * self.width + column, 0))
        squared_cells = jnp.where(inside, (found & jnp.uint16(0x7F)).astype(jnp.float32), self._far)
        unseen = inside & ((found & jnp.uint16(0x80)) > 0) & (squared_cells >= self._far)
        return squared_cells * self.resolution * self.resolution, unseen

    def sum_of_hits(
        self,
        ends: ScanPoints,
        pose: Float[Array, "3"],
        sigma: float | Float[Array, ""],
        unseen_score: float | Float[Array, ""],
    ) -> Float[Array, ""]:
        """Return the sum of exp(−d²/2σ²) over the valid beams of a scan at a base pose `[3]`; σ in meters.

        A beam that ends in unseen space counts as `unseen_score`.
        """
        squared, unseen = self.look_up(se2.apply(pose, ends.points))
        on_map = jnp.exp(-0.5 * squared / sigma**2)
        scores = jnp.where(unseen, unseen_score, on_map)
        return jnp.sum(jnp.where(ends.valid, scores, 0.0))

    def inlier_ratio(self, ends: ScanPoints, pose: Float[Array, "3"]) -> Float[Array, ""]:
        """Return the share of valid beams that, from a base pose `[3]`, end near an obstacle or unseen."""
        squared, unseen = self.look_up(se2.apply(pose, ends.points))
        return inlier_ratio(unseen | (squared < (self.radius * self.resolution) ** 2), ends.valid)

    @property
    def _far(self) -> float:
        return self.radius * self.radius + 1.0

    def across(
        self, points: Float[Array, "B 2"], normals: Float[Array, "B 2"]
    ) -> tuple[Float[Array, "B"], Float[Array, "B"], Float[Array, "B 2"]]:
        """Return how far the points lie from the nearest obstacle, measured across their walls.

        Where a wall continues beyond its mapped part, the nearest obstacle lies along the wall and would
        pull the scan back. The distance across the wall is zero there, so nothing is corrected.

        Args:
            points: `[B, 2]` meters, world frame.
            normals: `[B, 2]` unit normals of the walls, world frame; zero where unknown.

        Returns:
            Distance `[B]`, signed distance across the wall `[B]`, and the direction `[B, 2]` in which the
            signed distance grows, with the rate of growth as its length: the normal, or the gradient of the
            field where the normal is unknown. Distances are in cells, interpolated between cell centers.
        """
        distance, slope_x, slope_y = self._interpolate(points[:, 0], points[:, 1])
        x, y = normals[:, 0], normals[:, 1]
        flat = (x != 0.0) | (y != 0.0)
        cosine = jnp.where(flat, x * slope_x + y * slope_y, 1.0)
        direction = jnp.stack([jnp.where(flat, x, slope_x), jnp.where(flat, y, slope_y)], axis=-1)
        return distance, distance * cosine, direction

    def _interpolate(
        self, x: Float[Array, "B"], y: Float[Array, "B"]
    ) -> tuple[Float[Array, "B"], Float[Array, "B"], Float[Array, "B"]]:
        """Return distances in cells and their slopes, bilinear between cell centers, clamped to the field."""
        scale = 1.0 / self.resolution
        column = jnp.clip((x - self.origin[0]) * scale - 0.5, 0.0, self.width - 1.01)
        row = jnp.clip((y - self.origin[1]) * scale - 0.5, 0.0, self.height - 1.01)
        left, low = column.astype(jnp.int32), row.astype(jnp.int32)
        along, up = column - left.astype(jnp.float32), row - low.astype(jnp.float32)
        index = low * self.width + left
        mask, shift = jnp.uint16(0x7F), jnp.uint16(8)
        lower, upper = self._look_up(index), self._look_up(index + self.width)
        corners = (lower & mask, (lower >> shift) & mask, upper & mask, (upper >> shift) & mask)
        lower_left, lower_right, upper_left, upper_right = (jnp.sqrt(c.astype(jnp.float32)) for c in corners)
        slope_lower, slope_upper = lower_right - lower_left, upper_right - upper_left
        lower, upper = lower_left + along * slope_lower, upper_left + along * slope_upper
        slope_x = slope_lower + up * (slope_upper - slope_lower)
        slope_y = upper - lower
        return lower + up * slope_y, slope_x, slope_y

    def _look_up(self, index: Int[Array, "B"]) -> UInt16[Array, "B"]:
        return self.pairs.at[index].get(mode="promise_in_bounds", wrap_negative_indices=False)


class Field(eqx.Module):
    """Distance fields of a map window, for scoring and matching.

    Attributes:
        fine: distances at the map's own resolution.
        coarse: distances over `COARSE_FACTOR` times larger cells, which widen the matcher's basin.
    """

    fine: DistanceField
    coarse: DistanceField


def window_rows(size: int, radius: int) -> int:
    """Return the number of rows that a window of `size` columns needs: the field's rows and its margins."""
    return size + 2 * margin_rows(radius)


def prepare_field(
    window: Int8[Array, "rows size"],
    occupied_above: Int8[Array, ""],
    origin: Float[Array, "2"],
    resolution: Float[Array, ""],
    radius: int,
) -> Field:
    """Return the distance fields of a window of `window_rows` rows.

    Args:
        window: log-odds in fixed point; 0 where unseen.
        occupied_above: cells over this are obstacles.
        origin: `[2]` world position of the window's lower-left corner, meters.
        resolution: side of a cell, meters.
        radius: truncation radius of the fine level, cells (static).
    """
    rows, size = window.shape
    margin = margin_rows(radius)
    height = rows - 2 * margin
    fine = squared_distance_flat(window, occupied_above, radius)
    coarse = _coarsen(fine.reshape(height, size))
    half = COARSE_FACTOR // 2
    centers = window[margin + half : rows - margin : COARSE_FACTOR, half::COARSE_FACTOR]
    origin = origin + jnp.asarray([0.0, margin], jnp.float32) * resolution
    return Field(
        fine=DistanceField(_pairs(fine, window, margin), origin, resolution, height, size, radius),
        coarse=DistanceField(
            _pairs(coarse, centers, 0),
            origin,
            resolution * COARSE_FACTOR,
            height // COARSE_FACTOR,
            size // COARSE_FACTOR,
            COARSE_RADIUS,
        ),
    )


def _coarsen(fine: UInt8[Array, "H W"]) -> UInt8[Array, "cells"]:
    """Return squared distances in coarse cells, from every fourth row and column of the fine distances.

    No obstacle is missed: every obstacle lies within half a coarse diagonal, 2.8 cells, of a sample.
    """
    center = COARSE_FACTOR // 2
    sampled = fine[center::COARSE_FACTOR, center::COARSE_FACTOR]
    seeds = sampled <= jnp.uint8(center * center + center * center)
    padded = jnp.pad(seeds, ((margin_rows(COARSE_RADIUS),) * 2, (0, 0))).astype(jnp.int8)
    return squared_distance_flat(padded, jnp.int8(0), COARSE_RADIUS)


def _pairs(squared: UInt8[Array, "cells"], window: Int8[Array, "H W"], margin: int) -> UInt16[Array, "cells"]:
    """Pack each cell with its right neighbor, and mark cells that are unseen in the window.

    `margin` rows at the top and bottom of the window are skipped. The last cell of a row is packed with the
    first of the next row; no point reads that value.
    """

    def pack(cells: tuple[UInt8[Array, "cells"], Int8[Array, "H W"]]) -> UInt16[Array, "cells"]:
        squared, window = cells
        unseen = window[margin : window.shape[0] - margin] == 0
        marked = squared.astype(jnp.uint16) | (unseen.reshape(-1).astype(jnp.uint16) << jnp.uint16(7))
        return marked | (jnp.pad(marked[1:], (0, 1)) << jnp.uint16(8))

    return materialize(pack, (squared, window))


def field_of_map(
    occupied: Bool[Array, "H W"], origin: Float[Array, "2"], resolution: Float[Array, ""], radius: int
) -> Field:
    """Return the distance fields of a map of any size, valid up to the truncation radius beyond its edges.

    The map is padded with free space: `prepare_field` discards some columns and rows at the sides and needs
    whole coarse cells, and a point just outside the map can still be near an obstacle at its edge.

    Args:
        occupied: `[H, W]`, row 0 the lowest y.
        origin: `[2]` world position of the lower-left corner of cell (0, 0), meters.
        resolution: side of a cell, meters.
        radius: truncation radius, cells (static); 1 to 10, else a `ValueError` is raised.
    """
    height, width = occupied.shape
    # The coarse level reaches farther than the largest radius of the fine level.
    reach = COARSE_RADIUS * COARSE_FACTOR
    # Twice in columns: once for points beyond the map, once for the columns that `DistanceField` discards.
    left, below = 2 * reach, reach
    right = left + -width % COARSE_FACTOR
    above = below + -height % COARSE_FACTOR
    margin = margin_rows(radius)
    padded = jnp.pad(occupied, ((below + margin, above + margin), (left, right)))
    # The map is complete: no cell is unseen.
    log_odds = jnp.where(padded, jnp.int8(1), jnp.int8(-1))
    corner = origin - resolution * jnp.asarray([left, below + margin], jnp.float32)
    return prepare_field(log_odds, jnp.int8(0), corner, resolution, radius)
