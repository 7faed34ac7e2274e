import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.grid.box import Box, known_box
from jaxslam.grid.occupancy import LOG_ODDS_PER_UNIT
from jaxslam.viz import map_levels, shrink
from jaxslam.viz.raster import UNKNOWN_GRAY, gray_ramp


def test_levels_of_probabilities():
    levels = map_levels(np.array([[0.0, 1.0, 0.5, np.nan, 0.2]]))
    # 1 + 254 p; 0.5 and NaN are unknown.
    np.testing.assert_array_equal(levels, [[1, 255, 0, 0, 52]])


def test_levels_of_log_odds_are_those_of_their_probabilities():
    log_odds = np.arange(-128, 128, dtype=np.int8).reshape(16, 16)
    probability = 1 / (1 + np.exp(-log_odds.astype(float) * LOG_ODDS_PER_UNIT))
    np.testing.assert_array_equal(map_levels(log_odds), map_levels(probability))
    assert (map_levels(log_odds) == 0).sum() == 1


def test_device_arrays_and_levels_are_accepted():
    levels = map_levels(jnp.array([[0.0, 1.0]]))
    np.testing.assert_array_equal(levels, [[1, 255]])
    np.testing.assert_array_equal(map_levels(levels), levels)


def test_ramp_is_white_gray_black():
    ramp = gray_ramp()
    assert (ramp[1], ramp[0], ramp[128], ramp[255]) == (255, UNKNOWN_GRAY, UNKNOWN_GRAY, 0)
    assert (np.diff(ramp[1:].astype(int)) <= 0).all()


@pytest.mark.parametrize(("height", "width"), [(1, 1), (7, 11), (50, 60), (99, 120), (500, 500)])
def test_thin_walls_survive_shrinking(height, width):
    levels = np.full((100, 120), 1, np.uint8)
    levels[37] = 255
    levels[:, 81] = 255
    small = shrink(levels, height, width)
    assert small.shape == (min(height, 100), min(width, 120))
    assert ((small == 255).all(axis=1).sum(), (small == 255).all(axis=0).sum()) == (1, 1)


def test_shrinking_prefers_occupied_then_free_then_unknown():
    levels = np.array([[0, 0, 0, 1, 1, 200], [0, 0, 1, 0, 1, 1]], np.uint8)
    np.testing.assert_array_equal(shrink(levels, 1, 3), [[0, 1, 200]])


def test_known_box_and_its_extent():
    levels = np.zeros((10, 20), np.uint8)
    levels[3, 5] = levels[6, 8] = 1
    assert known_box(levels) == Box(3, 7, 5, 9)
    assert known_box(levels, margin=100) == Box(0, 10, 0, 20)
    assert known_box(np.zeros_like(levels)) == Box(0, 10, 0, 20)
    extent = known_box(levels).extent(0.5, np.array([-10.0, 4.0]))
    assert extent == (-7.5, -5.5, 5.5, 7.5)


@pytest.mark.parametrize(
    ("occupancy", "message"),
    [
        (np.zeros((0, 4)), r"shape \(0, 4\)"),
        (np.zeros(4), r"shape \(4,\)"),
        (np.array([[-3.0, 5.0]]), "run from -3 to 5"),
        (np.zeros((2, 2), np.int32), "type int32"),
        (np.zeros((2, 2), bool), "type bool"),
    ],
)
def test_bad_maps_are_one_clear_line(occupancy, message):
    with pytest.raises(ValueError, match=message) as caught:
        map_levels(occupancy)
    assert "\n" not in str(caught.value)
