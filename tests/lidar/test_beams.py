"""End points of beams in the base frame, and which beams are kept."""

import functools

import numpy as np
import pytest

from jaxslam.lidar import scan_points, spread_beams
from tests import builders

scan_of = functools.partial(builders.scan_of, increment=np.pi / 2)


def test_points_by_hand():
    scan = scan_of([1.0, 2.0, 3.0], [True, False, True], mounting=(0.5, -0.1, np.pi / 2))
    ends = scan_points(scan)
    # Turned a quarter: beam 0 points to +y, beam 2 to −y; beam 1 did not return and stays at the lidar.
    np.testing.assert_allclose(ends.points, [[0.5, 0.9], [0.5, -0.1], [0.5, -3.1]], atol=1e-6)
    np.testing.assert_array_equal(ends.valid, [True, False, True])


def test_clockwise_beams():
    ends = scan_points(scan_of([1.0, 1.0], [True, True], increment=-np.pi / 2))
    np.testing.assert_allclose(ends.points, [[1.0, 0.0], [0.0, -1.0]], atol=1e-6)


def test_a_range_that_is_not_valid_is_not_looked_at():
    ends = scan_points(scan_of([np.nan, np.inf], [False, False]))
    np.testing.assert_array_equal(ends.points, np.zeros((2, 2)))


def test_fewer_beams_are_a_spread_of_all():
    scan = scan_of(np.arange(1.0, 8.0), np.arange(7) != 3, increment=0.1)
    every, few = scan_points(scan), scan_points(scan, 3)
    np.testing.assert_allclose(few.points, np.asarray(every.points)[[0, 3, 6]], atol=1e-6)
    np.testing.assert_array_equal(few.valid, [True, False, True])
    np.testing.assert_array_equal(scan_points(scan, 100).points, every.points)


@pytest.mark.parametrize(
    ("num_beams", "max_beams"), [(1, 1), (181, 180), (360, 60), (5, 9), (682, 180), (7, 1)]
)
def test_spread_beams_are_evenly_spread(num_beams, max_beams):
    chosen = spread_beams(num_beams, max_beams)
    assert len(chosen) == min(num_beams, max_beams)
    assert len(set(chosen)) == len(chosen)
    gaps = np.diff(chosen)
    assert len(gaps) == 0 or (chosen[0] == 0 and chosen[-1] == num_beams - 1 and np.ptp(gaps) <= 1)
