"""Log-odds occupancy in int8, and the integration of a scan into a map window.

Log-odds are stored in fixed point, `LOG_ODDS_PER_UNIT` per unit. A map cell is one byte, so that gathers, on
which a filter spends most of its time, stay in cache.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Int8, Int16

from jaxslam.core.types import LidarScan
from jaxslam.xla.materialize import materialize

LOG_ODDS_PER_UNIT = 0.15
_LARGEST = 19.0
"""Largest log-odds that fit a byte."""
NUM_BEARINGS = 2048
"""Entries of a scan's range table. At 16 m one entry subtends one 5 cm cell. A power of two."""


class OccupancyModel(eqx.Module):
    """Inverse sensor model (Yang et al. 2019, equations 5 to 7): the change of a cell's log-odds by one scan.

    Attributes:
        hit: natural log-odds added where a beam ended.
        miss: natural log-odds added where a beam passed (negative). The default is a ninth of `hit`, because
            beams that graze a wall or are slightly misaligned erase it: a cell stays an obstacle as long as a
            tenth of the beams that reach it end there.
        limit: log-odds are clamped to ±limit, so that the map can still change; ≤ 19.
        occupied_above: log-odds above which a cell is an obstacle for the matcher and the sensor model.
        thinning_ratio: an obstacle must also have at least this fraction of the log-odds of its strongest
            neighbor, 0 to 1; see `jaxslam.grid.walls`. 0 keeps all obstacles.
    """

    hit: float | Float[Array, ""] = 2.7
    miss: float | Float[Array, ""] = -0.3
    limit: float | Float[Array, ""] = 15.0
    occupied_above: float | Float[Array, ""] = 2.0
    thinning_ratio: float | Float[Array, ""] = 0.5

    def __check_init__(self):
        bounds = {"hit": (0.0, _LARGEST), "miss": (-_LARGEST, 0.0), "limit": (0.0, _LARGEST)}
        bounds["occupied_above"] = (-_LARGEST, _LARGEST)
        bounds["thinning_ratio"] = (0.0, 1.0)
        for name, (low, high) in bounds.items():
            value = getattr(self, name)
            # The value of a traced array is unknown.
            if isinstance(value, int | float) and not low <= value <= high:
                raise ValueError(f"OccupancyModel: {name} is {value}, must be {low:g} to {high:g}")


def quantize(log_odds: float | Float[Array, ""]) -> Int8[Array, ""]:
    """Convert natural log-odds to the fixed-point format of the maps."""
    return jnp.clip(jnp.round(jnp.asarray(log_odds) / LOG_ODDS_PER_UNIT), -127, 127).astype(jnp.int8)


def probability(maps: Int8[Array, "*shape"]) -> Float[Array, "*shape"]:
    """Return the occupancy probability of fixed-point log-odds; ½ where unseen."""
    return jax.nn.sigmoid(maps.astype(jnp.float32) * LOG_ODDS_PER_UNIT)


class RangeTable(eqx.Module):
    """Table of the free range of a scan over bearing.

    Attributes:
        free_until: `[NUM_BEARINGS]` range up to which space is free, half cells; 0 where unknown. Entry `k`
            is at the angle `2πk / NUM_BEARINGS` in the lidar frame.
    """

    free_until: Int16[Array, "n"]


class CellsFromLidar(eqx.Module):
    """Bearings and distances of the cells of a window, from the cell of the lidar.

    Attributes:
        bearing: `[S, S]` index into a `RangeTable`, modulo its length.
        distance: `[S, S]` half cells, rounded up.
    """

    bearing: Int16[Array, "S S"]
    distance: Int16[Array, "S S"]


def range_table(scan: LidarScan, resolution: Float[Array, ""], max_cells: int) -> RangeTable:
    """Tabulate a scan over bearing, once for all particles.

    Between two beams, the shorter range is used: at a grazing angle, the longer would carve into the wall.
    """

    def tabulate(scan: LidarScan) -> Int16[Array, "n"]:
        position = _position_among_beams(scan)
        # Within half a beam before beam 0, the nearest beam is beam 0, not the last one.
        behind = position >= 2 * jnp.pi / jnp.abs(scan.angle_increment) - 0.5
        nearest = _reach(scan, jnp.where(behind, 0.0, jnp.round(position)))
        below, above = _reach(scan, jnp.floor(position)), _reach(scan, jnp.ceil(position))
        shorter = jnp.where((below > 0) & (above > 0), jnp.minimum(below, above), nearest)
        half_cells = jnp.floor(2 * shorter / resolution)
        return jnp.clip(half_cells, 0, 2 * max_cells).astype(jnp.int16)

    return RangeTable(materialize(tabulate, scan))


def _position_among_beams(scan: LidarScan) -> Float[Array, "n"]:
    """Return the fractional beam index of each table bearing, from 0 to the beams of a full turn."""
    bearing = jnp.arange(NUM_BEARINGS, dtype=jnp.float32) * (2 * np.pi / NUM_BEARINGS)
    direction, spacing = jnp.sign(scan.angle_increment), jnp.abs(scan.angle_increment)
    return jnp.mod((bearing - scan.angle_min) * direction, 2 * jnp.pi) / spacing


def _reach(scan: LidarScan, beam: Float[Array, "n"]) -> Float[Array, "n"]:
    """Return the range of the beams with the given indices; 0 if there is no such beam or no return."""
    # After a full turn comes beam 0 again, so that a 360° lidar has no gap there. The tolerance of a quarter
    # beam is needed because angle increments are often rounded.
    whole_turn = jnp.ceil(2 * jnp.pi / jnp.abs(scan.angle_increment) - 0.25).astype(jnp.int32)
    index = jnp.mod(beam.astype(jnp.int32), whole_turn)
    inside = index < scan.num_beams
    clipped = jnp.clip(index, 0, scan.num_beams - 1)
    return jnp.where(inside & scan.valid[clipped], scan.ranges[clipped], 0.0)


def add_scan(
    model: OccupancyModel,
    window: Int8[Array, "S S"],
    table: RangeTable,
    cells: CellsFromLidar,
    hits: Int[Array, "B 2"],
    valid: Bool[Array, "B"],
    heading: Float[Array, ""],
) -> Int8[Array, "S S"]:
    """Add one scan to a map window.

    Each cell reads the table of the scan once and changes at most once, so the cost depends on the size of
    the window, not on the number of beams. Hits are placed exactly. Free space ends one cell before them,
    because bearings are relative to the center of the lidar's cell instead of the lidar.

    Args:
        model: log-odds to add.
        window: `[S, S]` fixed-point log-odds.
        table: the scan, tabulated over bearing.
        cells: bearings and distances of the window's cells from the lidar.
        hits: `[B, 2]` (row, column) of the beams' end points in the window.
        valid: `[B]` whether each end point counts.
        heading: heading of the lidar in the world, radians.
    """
    size = window.shape[0]
    shift = jnp.round(heading * (NUM_BEARINGS / (2 * np.pi))).astype(jnp.int16)
    # In two's complement, the mask also maps negative differences to the correct entry.
    index = (cells.bearing - shift) & jnp.int16(NUM_BEARINGS - 1)
    free_until = table.free_until.at[index].get(mode="promise_in_bounds", wrap_negative_indices=False)
    free = cells.distance + jnp.int16(2) <= free_until
    # An index past the end is dropped, but a negative one would wrap around.
    row = jnp.where(valid & jnp.all(hits >= 0, axis=1), hits[:, 0], size)
    before = window.at[row, hits[:, 1]].get(mode="fill", fill_value=0)
    cleared = _add(model, window, jnp.where(free, quantize(model.miss), jnp.int8(0)))
    return cleared.at[row, hits[:, 1]].set(_add(model, before, quantize(model.hit)), mode="drop")


def _add(
    model: OccupancyModel, log_odds: Int8[Array, "*shape"], change: Int8[Array, "..."]
) -> Int8[Array, "*shape"]:
    limit = quantize(model.limit).astype(jnp.int16)
    total = log_odds.astype(jnp.int16) + change.astype(jnp.int16)
    return jnp.clip(total, -limit, limit).astype(jnp.int8)


def cells_from_lidar(size: int, shift: Int[Array, "2"]) -> CellsFromLidar:
    """Compute bearings and distances of a window's cells from its lidar, once for all particles.

    Args:
        size: cells along a side (static).
        shift: `[2]` rows and columns from the lidar's cell to the window's center cell, less than half
            of `size`.
    """
    offset = np.arange(2 * size) - size
    dx, dy = np.meshgrid(offset, offset)
    bearing = np.round(np.arctan2(dy, dx) * (NUM_BEARINGS / (2 * np.pi))).astype(np.int16)
    distance = np.ceil(2 * np.hypot(dx, dy)).astype(np.int16)
    start = size - size // 2 + shift

    def cut(start: Int[Array, "2"]) -> Int16[Array, "2 S S"]:
        both = jnp.asarray(np.stack([bearing, distance]))
        return jax.lax.dynamic_slice(both, (0, start[0], start[1]), (2, size, size))

    found = materialize(cut, start)
    return CellsFromLidar(found[0], found[1])
