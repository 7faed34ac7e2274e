"""Log-odds occupancy in int8, and the integration of a scan into a map window.

Log-odds are stored in fixed point, in steps of `LOG_ODDS_PER_UNIT`. A map cell is therefore one byte, and
the gathers that dominate a filter's run time stay in cache.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Int8, Int16

from jaxslam.core.types import LidarScan
from jaxslam.core.validation import require_within
from jaxslam.xla.materialize import materialize

LOG_ODDS_PER_UNIT = 0.15
_LARGEST = 19.0
"""Largest log-odds that fit a byte."""
NUM_BEARINGS = 2048
"""Entries of a scan's range table. At 16 m one entry subtends one 5 cm cell. A power of two."""


class OccupancyModel(eqx.Module):
    """Inverse sensor model, Yang et al. 2019 (5)–(7): what one scan adds to the log-odds of a cell.

    Attributes:
        hit: added where a beam ended, natural log-odds.
        miss: added where a beam passed, natural log-odds (negative). At a ninth of `hit`, a cell remains an
            obstacle as long as a tenth of the beams that reach it end there. A larger value would let beams
            that graze a wall or are slightly misplaced erase it.
        limit: log-odds are clamped to ±limit, so that later scans can still change a cell; ≤ 19.
        occupied_above: cells over this are obstacles to the matcher and the sensor model, log-odds.
        thinning_ratio: share of the log-odds of the strongest nearby cell that an obstacle needs, 0 to 1;
            see `jaxslam.grid.walls`. 0 keeps all cells.
    """

    hit: float | Float[Array, ""] = 2.7
    miss: float | Float[Array, ""] = -0.3
    limit: float | Float[Array, ""] = 15.0
    occupied_above: float | Float[Array, ""] = 2.0
    thinning_ratio: float | Float[Array, ""] = 0.5

    def __check_init__(self):
        require_within(self, hit=(0, _LARGEST), miss=(-_LARGEST, 0), limit=(0, _LARGEST))
        require_within(self, occupied_above=(-_LARGEST, _LARGEST), thinning_ratio=(0, 1))


def quantize(log_odds: float | Float[Array, ""]) -> Int8[Array, ""]:
    """Convert natural log-odds to the fixed point of the maps."""
    return jnp.clip(jnp.round(jnp.asarray(log_odds) / LOG_ODDS_PER_UNIT), -127, 127).astype(jnp.int8)


def range_table(scan: LidarScan, resolution: Float[Array, ""], max_cells: int) -> Int16[Array, "n"]:
    """Tabulate the range of free space by bearing, once for all particles.

    Between two beams the shorter range is used: on a wall seen at a grazing angle, the longer one would
    mark part of the wall free.

    Returns:
        `[NUM_BEARINGS]` half cells; 0 where unknown. Entry `k` is at the angle `2πk / NUM_BEARINGS` in the
        lidar frame.
    """

    def tabulate(scan: LidarScan) -> Int16[Array, "n"]:
        position = _position_among_beams(scan)
        # The last half beam before a full turn is nearer to beam 0 than to the last beam.
        behind = position >= 2 * jnp.pi / jnp.abs(scan.angle_increment) - 0.5
        nearest = _reach(scan, jnp.where(behind, 0.0, jnp.round(position)))
        below, above = _reach(scan, jnp.floor(position)), _reach(scan, jnp.ceil(position))
        shorter = jnp.where((below > 0) & (above > 0), jnp.minimum(below, above), nearest)
        half_cells = jnp.floor(2 * shorter / resolution)
        return jnp.clip(half_cells, 0, 2 * max_cells).astype(jnp.int16)

    return materialize(tabulate, scan)


def _position_among_beams(scan: LidarScan) -> Float[Array, "n"]:
    """Return the unrounded index of the beam at each bearing of the table, over a whole turn."""
    bearing = jnp.arange(NUM_BEARINGS, dtype=jnp.float32) * (2 * np.pi / NUM_BEARINGS)
    direction, spacing = jnp.sign(scan.angle_increment), jnp.abs(scan.angle_increment)
    return jnp.mod((bearing - scan.angle_min) * direction, 2 * jnp.pi) / spacing


def _reach(scan: LidarScan, beam: Float[Array, "n"]) -> Float[Array, "n"]:
    """Return the range of the beams with the given indices; 0 where a beam is missing or did not return."""
    # One whole turn after beam 0 is beam 0 again, so a 360° lidar has no gap there.
    # The tolerance is a quarter of a beam, because increments are often rounded.
    whole_turn = jnp.ceil(2 * jnp.pi / jnp.abs(scan.angle_increment) - 0.25).astype(jnp.int32)
    index = jnp.mod(beam.astype(jnp.int32), whole_turn)
    inside = index < scan.num_beams
    clipped = jnp.clip(index, 0, scan.num_beams - 1)
    return jnp.where(inside & scan.valid[clipped], scan.ranges[clipped], 0.0)


def add_scan(
    model: OccupancyModel,
    window: Int8[Array, "S S"],
    table: Int16[Array, "n"],
    cells: tuple[Int16[Array, "S S"], Int16[Array, "S S"]],
    hits: Int[Array, "B 2"],
    valid: Bool[Array, "B"],
    heading: Float[Array, ""],
) -> Int8[Array, "S S"]:
    """Add one scan to a map window.

    Every cell looks itself up in the scan's table and changes at most once, so the cost depends on the
    window and not on the number of beams. Hits are placed exactly. Free space ends one cell before them,
    because bearings are taken from the center of the lidar's cell instead of the lidar.

    Args:
        model: log-odds to add.
        window: `[S, S]` fixed-point log-odds.
        table: the scan by bearing, from `range_table`.
        cells: position of the window's cells relative to the lidar, from `cells_from_lidar`.
        hits: `[B, 2]` (row, column) of the beams' end points in the window.
        valid: `[B]` which of them count.
        heading: heading of the lidar in the world, radians.
    """
    bearing, distance = cells
    shift = jnp.round(heading * (NUM_BEARINGS / (2 * np.pi))).astype(jnp.int16)
    # In two's complement the mask maps negative differences to the right entry as well.
    index = (bearing - shift) & jnp.int16(NUM_BEARINGS - 1)
    free_until = table.at[index].get(mode="promise_in_bounds", wrap_negative_indices=False)
    free = distance + jnp.int16(2) <= free_until
    # An index past the end is dropped; a negative one would wrap around.
    row = jnp.where(valid & jnp.all(hits >= 0, axis=1), hits[:, 0], window.shape[0])
    before = window.at[row, hits[:, 1]].get(mode="fill", fill_value=0)
    cleared = _add(model, window, jnp.where(free, quantize(model.miss), jnp.int8(0)))
    return cleared.at[row, hits[:, 1]].set(_add(model, before, quantize(model.hit)), mode="drop")


def _add(
    model: OccupancyModel, log_odds: Int8[Array, "*shape"], change: Int8[Array, "..."]
) -> Int8[Array, "*shape"]:
    limit = quantize(model.limit).astype(jnp.int16)
    total = log_odds.astype(jnp.int16) + change.astype(jnp.int16)
    return jnp.clip(total, -limit, limit).astype(jnp.int8)


def cells_from_lidar(size: int, shift: Int[Array, "2"]) -> tuple[Int16[Array, "S S"], Int16[Array, "S S"]]:
    """Return the position of a window's cells relative to its lidar, once for all particles.

    Args:
        size: cells along a side (static).
        shift: `[2]` rows and columns from the lidar's cell to the window's center cell, less than half
            of `size`.

    Returns:
        Bearing of each cell `[S, S]`, an index into a range table modulo its length, and distance `[S, S]` in
        half cells, rounded up.
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
    return found[0], found[1]
