"""Windows cut out of and put back into maps, and maps copied after resampling."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.grid.spec import GridSpec
from jaxslam.grid.window import (
    copy_maps,
    inside_window,
    read_windows,
    shift_to_scan,
    window_origin,
    window_start,
    write_windows,
)

SPEC = GridSpec(jnp.float32(0.5), jnp.asarray([-2.0, 1.0], jnp.float32), height=12, width=16)
jitted_start = jax.jit(window_start, static_argnums=2)


def start_of(spec, position, shape, shift=(0, 0)):
    return jitted_start(spec, position, shape, jnp.asarray(shift, jnp.int32))


def maps_of(count):
    return jnp.asarray(np.random.default_rng(0).integers(-100, 100, (count, 12, 16)), jnp.int8)


@pytest.mark.parametrize(
    ("position", "start", "moved"),
    [
        # Position (2.1, 4.2) is in cell row 6, column 8: a 4 × 6 window begins 2 rows and 3 columns before.
        ((2.1, 4.2), (4, 5), False),
        # The first and the last place that fit: center cells (2, 3) and (10, 13).
        ((-0.5, 2.0), (0, 0), False),
        ((4.5, 6.0), (8, 10), False),
        ((-0.51, 2.0), (0, 0), True),
        ((-0.5, 1.99), (0, 0), True),
        ((5.0, 6.0), (8, 10), True),
        ((4.5, 6.5), (8, 10), True),
        ((-1e6, 1e6), (8, 0), True),
    ],
)
def test_start_of_a_window(position, start, moved):
    found, was_moved = start_of(SPEC, jnp.asarray(position, jnp.float32), (4, 6))
    np.testing.assert_array_equal(found, start)
    assert bool(was_moved) == moved


def test_a_map_smaller_than_the_window_is_off_the_map():
    assert bool(start_of(SPEC, jnp.asarray([2.0, 4.0], jnp.float32), (13, 6))[1])


def test_origin_is_the_lower_left_corner():
    origin = window_origin(SPEC, jnp.asarray([3, 5], jnp.int32))
    np.testing.assert_allclose(origin, [-2.0 + 5 * 0.5, 1.0 + 3 * 0.5])


def test_read_and_write_are_slices():
    maps, starts = maps_of(3), jnp.asarray([[0, 0], [8, 10], [3, 7]], jnp.int32)
    windows = jax.jit(read_windows, static_argnums=2)(maps, starts, (4, 6))
    expected = np.array(maps)
    for window, grid, (row, column) in zip(windows, np.asarray(maps), np.asarray(starts), strict=True):
        np.testing.assert_array_equal(window, grid[row : row + 4, column : column + 6])
    written = jax.jit(write_windows)(maps, windows + jnp.int8(1), starts)
    for grid, (row, column) in zip(expected, np.asarray(starts), strict=True):
        grid[row : row + 4, column : column + 6] += 1
    np.testing.assert_array_equal(written, expected)


@pytest.mark.parametrize(
    "ancestors", [[0, 1, 2, 3, 4], [0, 0, 0, 0, 0], [0, 1, 1, 4, 4], [2, 1, 2, 1, 4], [4, 4, 4, 4, 4]]
)
def test_every_slot_gets_its_ancestors_map(ancestors):
    maps, ancestors = maps_of(5), np.asarray(ancestors, np.int32)
    copied = jax.jit(copy_maps)(maps, jnp.asarray(ancestors))
    np.testing.assert_array_equal(copied, np.asarray(maps)[ancestors])


def shift_of(ends, size=100):
    return np.asarray(jax.jit(shift_to_scan, static_argnums=2)(jnp.asarray(ends), jnp.float32(0.1), size))


def test_a_window_that_holds_the_scan_stays_around_the_lidar():
    np.testing.assert_array_equal(shift_of([[4.0, -3.0], [-2.0, 4.5]]), [0, 0])


def test_a_window_lies_ahead_of_a_lidar_that_sees_farther():
    # Ends from 0 to 8 m along x in a window that reaches 5 m: its middle lies 4 m ahead, kept to 3 m so
    # that the lidar stays 20 cells from the edge. Along y all fits.
    np.testing.assert_array_equal(shift_of([[8.0, -1.0], [0.0, 1.0]]), [0, 30])
    np.testing.assert_array_equal(shift_of([[-1.0, 2.0], [1.0, -6.0]]), [-20, 0])


def test_a_window_start_is_moved_by_the_shift():
    position = jnp.asarray([2.1, 4.2], jnp.float32)
    np.testing.assert_array_equal(start_of(SPEC, position, (4, 6), (1, -2))[0], [5, 3])


def test_ends_off_the_window_do_not_count():
    ends, shift = jnp.asarray([[8.0, 0.0], [0.0, 0.0], [-1.9, 0.0], [0.0, 4.8]]), jnp.asarray([0, 30])
    inside = jax.jit(inside_window, static_argnums=2)(ends, jnp.float32(0.1), 100, shift)
    # From −2 m + 4 cells to 8 m − 4 cells along x, and ±5 m less 4 cells along y.
    np.testing.assert_array_equal(inside, [False, True, False, False])
