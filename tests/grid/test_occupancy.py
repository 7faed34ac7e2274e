"""Scan integration: a map by hand, and cell by cell against the beams."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.grid.occupancy import (
    LOG_ODDS_PER_UNIT,
    NUM_BEARINGS,
    OccupancyModel,
    add_scan,
    cells_from_lidar,
    quantize,
    range_table,
)
from tests.builders import scan_of

MODEL = OccupancyModel(hit=2.7, miss=-1.2, limit=15.0, occupied_above=1.5)
HIT, MISS, LIMIT = 18, -8, 100
SIZE, RESOLUTION = 61, 0.1
ENTRY = 2 * np.pi / NUM_BEARINGS


def beam_ends(scan, heading, resolution=RESOLUTION, size=SIZE):
    """(row, column) in the window of the beams of a lidar in the middle of the center cell, in NumPy."""
    angles = heading + float(scan.angle_min) + float(scan.angle_increment) * np.arange(scan.num_beams)
    reach = np.asarray(scan.ranges, np.float64) / resolution
    offset = np.stack([reach * np.sin(angles), reach * np.cos(angles)], axis=-1)
    return np.floor(offset + 0.5).astype(np.int32) + size // 2


@jax.jit
def integrate(model, window, scan, hits, heading, resolution, shift=None):
    table = range_table(scan, resolution, window.shape[0] // 2)
    shift = jnp.zeros(2, jnp.int32) if shift is None else shift
    cells = cells_from_lidar(window.shape[0], shift)
    return add_scan(model, window, table, cells, hits, scan.valid, heading)


def added(scan, heading=0.0, window=None, resolution=RESOLUTION, size=SIZE, model=MODEL):
    window = jnp.zeros((size, size), jnp.int8) if window is None else window
    hits = jnp.asarray(beam_ends(scan, heading, resolution, size))
    return np.asarray(
        integrate(model, window, scan, hits, jnp.float32(heading), jnp.float32(resolution)), int
    )


def random_scan(seed, num_beams=40, share_invalid=0.2, **geometry):
    random = np.random.default_rng(seed)
    valid = random.random(num_beams) >= share_invalid
    return scan_of(np.where(valid, random.uniform(0.5, 2.7, num_beams), 0.0), **geometry)


def test_five_by_five_by_hand():
    # Ends two cells away: the cell one before them is the last that is free; diagonals are √2 away.
    window = added(scan_of([2.0, 2.0, 2.0, 2.0]), resolution=1.0, size=5)
    expected = [
        [0, 0, 18, 0, 0],
        [0, 0, -8, 0, 0],
        [18, -8, -8, -8, 18],
        [0, 0, -8, 0, 0],
        [0, 0, 18, 0, 0],
    ]
    np.testing.assert_array_equal(window, expected)


GEOMETRIES = {
    "whole turn": {},
    "clockwise": {"angle_min": 1.0, "increment": -2 * np.pi / 40},
    "180 degrees": {"angle_min": -np.pi / 2, "increment": np.pi / 39},
    "240 degrees, backwards over the seam": {"angle_min": np.pi / 2, "increment": 4 * np.pi / 3 / 39},
}


@pytest.mark.parametrize("geometry", GEOMETRIES.values(), ids=GEOMETRIES.keys())
@pytest.mark.parametrize("heading", [0.0, 0.77, -3.1])
def test_against_the_beams_one_by_one(geometry, heading):
    for seed in range(5):
        scan = random_scan(seed, **geometry)
        change = added(scan, heading)
        ends = beam_ends(scan, heading)[np.asarray(scan.valid)]
        is_end = np.zeros((SIZE, SIZE), bool)
        is_end[ends[:, 0], ends[:, 1]] = True

        # Every hit cell is hit, and nothing changes twice.
        assert set(np.unique(change)) <= {0, HIT, MISS}
        np.testing.assert_array_equal(change == HIT, is_end)
        must, may = cells_to_free(scan, heading)
        assert not ((change == MISS) & ~may).any()
        assert not ((change == 0) & must & ~is_end).any()


def cells_to_free(scan, heading):
    """Cells that must and that may be freed, from the beams on both sides of each cell's bearing, in NumPy.

    Bearings are rounded to half an entry for the cell and half for the heading, distances to half a cell.
    """
    rows, columns = np.indices((SIZE, SIZE)) - SIZE // 2
    distance = np.hypot(rows, columns)[..., None] * RESOLUTION
    angles = heading + float(scan.angle_min) + float(scan.angle_increment) * np.arange(scan.num_beams)
    away = np.abs((np.arctan2(rows, columns)[..., None] - angles + np.pi) % (2 * np.pi) - np.pi)
    spacing = abs(float(scan.angle_increment))
    reach = np.where(np.asarray(scan.valid), np.asarray(scan.ranges, np.float64), 0.0)
    # A cell is freed by its nearest beam; both neighbors must reach it for it to be certain.
    near = away <= 0.5 * spacing + 1.01 * ENTRY
    may = (near & (reach >= distance + RESOLUTION - 1e-3)).any(axis=-1)
    around = away <= spacing + 1.01 * ENTRY
    inside = (away <= 0.5 * spacing - 1.01 * ENTRY).any(axis=-1)
    must = (~around | (reach >= distance + 2.0 * RESOLUTION)).all(axis=-1) & inside
    return must, may


def test_a_whole_turn_leaves_no_gap_behind_the_last_beam():
    for num_beams in (8, 40, 360):
        change = added(scan_of(np.full(num_beams, 2.5)))
        rows, columns = np.indices((SIZE, SIZE)) - SIZE // 2
        free = np.hypot(rows, columns) <= 23.0
        assert (change[free] == MISS).all()


def test_clockwise_beams_make_the_same_map():
    scan = random_scan(3, angle_min=-1.2, increment=2.4 / 39)
    ranges, valid = np.asarray(scan.ranges)[::-1], np.asarray(scan.valid)[::-1]
    clockwise = scan_of(ranges, valid, angle_min=1.2, increment=-2.4 / 39)
    first, second = added(scan, 0.4), added(clockwise, 0.4)
    # Rounding may move the boundary between two beams by one entry of the table.
    assert np.mean(first != second) < 0.002


def test_turning_the_lidar_is_turning_the_map():
    scan = random_scan(4)
    # A quarter turn is a whole number of entries; ends on a cell's edge may round to either side.
    turned, plain = added(scan, np.pi / 2), added(scan, 0.0)
    assert np.mean(np.rot90(plain, -1) != turned) < 0.002


@pytest.mark.parametrize("heading", np.linspace(-0.4, 0.4, 5))
def test_a_wall_at_a_grazing_angle_is_not_eroded(heading):
    """A robot 0.3 m beside a straight wall, 1° beams: no cell of the wall's row becomes free."""
    angles = np.deg2rad(np.arange(-90, 91))
    with np.errstate(divide="ignore"):
        ranges = 0.3 / np.abs(np.sin(angles + heading))
    valid = ranges < 2.9
    scan = scan_of(np.where(valid, ranges, 0.0), angle_min=-np.pi / 2, increment=np.deg2rad(1.0))
    window = jnp.zeros((SIZE, SIZE), jnp.int8)
    for _ in range(5):
        window = jnp.asarray(added(scan, heading, window), jnp.int8)
    wall = np.asarray(window)[[SIZE // 2 - 3, SIZE // 2 + 3]]
    assert (wall >= 0).all()
    # It was seen, and the space before it is free.
    assert (wall > 0).sum() > 20
    assert (np.asarray(window) == 5 * MISS).sum() > 50


def test_beams_without_return_change_nothing():
    scan = scan_of(np.zeros(40))
    assert not added(scan).any()
    one = np.arange(40) == 10
    change = added(scan_of(np.where(one, 2.0, 0.0)))
    rows, columns = np.nonzero(change == MISS)
    # Only beam 10 (a quarter turn) returned: its half spacings on both sides, and the lidar's own cell.
    off_axis = np.abs(np.arctan2(columns - SIZE // 2, rows - SIZE // 2))
    assert off_axis.max() <= np.pi / 40 + ENTRY
    assert rows.max() == SIZE // 2 + 19


def test_log_odds_stay_within_the_limit():
    scan = scan_of(np.full(40, 2.0))
    window = jnp.zeros((SIZE, SIZE), jnp.int8)
    for _ in range(20):
        window = jnp.asarray(added(scan, window=window), jnp.int8)
    assert window.max() == LIMIT
    assert window.min() == -LIMIT


def test_ends_outside_the_window_are_dropped():
    scan = scan_of([50.0, 50.0, 50.0, 50.0])
    change = added(scan)
    # Nothing is hit, nothing wraps round, and the window is free as far as the table goes.
    assert set(np.unique(change)) == {0, MISS}
    assert change[SIZE // 2, 2] == MISS


def test_a_broken_scan_leaves_numbers():
    scan = scan_of(np.full(40, 2.0))
    scan = eqx.tree_at(
        lambda s: (s.ranges, s.valid), scan, (scan.ranges.at[3].set(jnp.nan), scan.valid.at[3].set(False))
    )
    hits = jnp.asarray(np.full((40, 2), -5), jnp.int32)
    change = integrate(
        MODEL, jnp.zeros((SIZE, SIZE), jnp.int8), scan, hits, jnp.float32(0), jnp.float32(RESOLUTION)
    )
    assert set(np.unique(change)) == {0, MISS}


def test_range_table_by_hand():
    scan = scan_of([1.0, 2.0, 3.0, 0.0])
    free_until = np.asarray(range_table(scan, jnp.float32(0.5), 5))
    quarter = NUM_BEARINGS // 4
    # In half cells of 0.25 m; the limit of 5 cells is 10 half cells.
    assert (free_until[0], free_until[quarter], free_until[2 * quarter], free_until[3 * quarter]) == (
        4,
        8,
        10,
        0,
    )
    # Between two beams the shorter, beside one that did not return the nearest.
    assert (free_until[1:quarter] == 4).all()
    assert (free_until[quarter + 1 : 2 * quarter] == 8).all()
    assert free_until[2 * quarter + 10] == 10
    assert free_until[3 * quarter - 10] == 0
    assert free_until[-10] == 4


def test_fixed_point():
    assert int(quantize(2.7)) == round(2.7 / LOG_ODDS_PER_UNIT) == HIT
    assert int(quantize(1000.0)) == 127
    assert int(quantize(-1000.0)) == -127


def test_a_window_ahead_of_the_lidar_gets_the_same_cells():
    """What two windows share, they agree about: one around the lidar, one shifted by rows and columns."""
    scan, shift = random_scan(11), np.array([7, -12])
    window = jnp.zeros((SIZE, SIZE), jnp.int8)
    hits = beam_ends(scan, 0.3)
    around, ahead = (
        np.asarray(
            integrate(
                MODEL, window, scan, jnp.asarray(hits - by, jnp.int32), jnp.float32(0.3),
                jnp.float32(RESOLUTION), jnp.asarray(by, jnp.int32),
            )
        )
        for by in (np.zeros(2, int), shift)
    )  # fmt: skip
    assert np.abs(ahead).max() > 0
    np.testing.assert_array_equal(around[7:, :-12], ahead[:-7, 12:])
