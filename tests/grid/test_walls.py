"""Which cells stand out, by hand and against a plain loop."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.grid import OccupancyModel, thin_walls
from jaxslam.grid.walls import NEIGHBORS


def by_loops(window, share):
    result = window.copy()
    for row, column in np.ndindex(window.shape):
        low, left = max(row - NEIGHBORS, 0), max(column - NEIGHBORS, 0)
        strongest = window[low : row + NEIGHBORS + 1, left : column + NEIGHBORS + 1].max()
        if 0 < window[row, column] < share * strongest:
            result[row, column] = -1
    return result


def test_a_smeared_wall_becomes_thin():
    window = np.zeros((9, 11), np.int8)
    window[3:6] = np.array([20, 100, 45], np.int8)[:, None]
    found = np.asarray(thin_walls(OccupancyModel(thinning_ratio=0.5), jnp.asarray(window)))
    assert (found[4] == 100).all()
    assert (found[[3, 5]] == -1).all()
    assert (found[[0, 1, 2, 6, 7, 8]] == 0).all()


def test_a_wall_seen_once_stays():
    window = np.zeros((9, 11), np.int8)
    window[4, ::3] = 18
    np.testing.assert_array_equal(thin_walls(OccupancyModel(), jnp.asarray(window)), window)


def test_as_loops_say_away_from_the_sides():
    # Units of a 64th, so that both round alike.
    random = np.random.default_rng(1)
    window = random.choice([-60, -3, 0, 5, 18, 40, 99, 127], (40, 30)).astype(np.int8)
    for share in (0.0, 0.25, 0.5, 1.0):
        found = jax.jit(thin_walls)(OccupancyModel(thinning_ratio=share), jnp.asarray(window))
        inner = np.s_[:, NEIGHBORS:-NEIGHBORS]
        np.testing.assert_array_equal(np.asarray(found)[inner], by_loops(window, share)[inner])


def test_no_share_takes_all_cells():
    window = np.full((5, 9), 3, np.int8)
    window[2, 4] = 127
    np.testing.assert_array_equal(thin_walls(OccupancyModel(thinning_ratio=0.0), jnp.asarray(window)), window)


def test_free_and_unknown_cells_stay_what_they_are():
    window = np.zeros((7, 7), np.int8)
    window[3, 3], window[3, 4] = 127, -30
    found = np.asarray(thin_walls(OccupancyModel(), jnp.asarray(window)))
    np.testing.assert_array_equal(found, window)


def test_a_share_over_one_is_refused():
    with pytest.raises(ValueError, match=r"thinning_ratio is 1\.5"):
        OccupancyModel(thinning_ratio=1.5)
