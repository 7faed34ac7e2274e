"""Features of one map found again in another."""

import dataclasses

import numpy as np
import pytest

from jaxslam.metrics import BinaryMap, match_features


def rooms(seed: int = 0, height: int = 300, width: int = 400) -> BinaryMap:
    """Boxes in free space, as a map has them: random, and so with many different corners."""
    rng = np.random.default_rng(seed)
    occupied = np.zeros((height, width), bool)
    for _ in range(40):
        row, column = rng.integers(30, height - 60), rng.integers(30, width - 60)
        occupied[row : row + rng.integers(4, 30), column : column + rng.integers(4, 30)] = True
    known = np.zeros_like(occupied)
    known[20:-20, 20:-20] = True
    return BinaryMap(occupied, known & ~occupied, 0.05, np.array([-3.0, 2.0]))


def moved(known: BinaryMap, x: float, y: float) -> BinaryMap:
    return dataclasses.replace(known, origin=known.origin + np.array([x, y]))


def test_a_map_matches_itself_whole():
    found = match_features(rooms(), rooms())
    assert found.inliers == found.matches > 100
    np.testing.assert_allclose(found.pose, 0.0, atol=1e-6)


def test_the_motion_between_maps_is_found():
    found = match_features(rooms(), moved(rooms(), 1.5, -0.5))
    assert found.inliers == found.matches
    np.testing.assert_allclose(found.pose, [-1.5, 0.5, 0.0], atol=1e-6)
    quarter = rooms()
    turned = BinaryMap(np.rot90(quarter.occupied), np.rot90(quarter.free), 0.05, np.zeros(2))
    found = match_features(quarter, turned)
    assert found.inliers > 0.8 * found.matches
    assert abs(abs(found.pose[2]) - np.pi / 2) < 0.01


def test_what_spoils_a_map_costs_inliers():
    rng = np.random.default_rng(1)
    true = rooms()
    noise = rng.random(true.occupied.shape) < 0.03
    noisy = BinaryMap(true.occupied | noise, true.free & ~noise, 0.05, true.origin)
    doubled = true.occupied | np.roll(true.occupied, (9, 9), (0, 1))
    broken = BinaryMap(doubled, true.free & ~doubled, 0.05, true.origin)
    whole = match_features(true, true).inliers
    assert match_features(true, noisy).inliers < 0.8 * whole
    assert match_features(true, broken).inliers < 0.6 * whole
    assert match_features(true, rooms(seed=5)).inliers < 0.1 * whole


def test_the_same_seed_gives_the_same():
    first, second = (match_features(rooms(), rooms(seed=5), seed=3) for _ in range(2))
    assert first.inliers == second.inliers
    np.testing.assert_array_equal(first.pose, second.pose)


def test_maps_without_features_have_no_inliers():
    empty = BinaryMap(np.zeros((200, 200), bool), np.ones((200, 200), bool), 0.05, np.zeros(2))
    found = match_features(rooms(), empty)
    assert found.inliers == found.matches == 0
    assert found.features[1] == 0
    assert np.isnan(found.pose).all()


def test_cells_must_be_of_one_size():
    with pytest.raises(ValueError, match=r"cells of 0.05 m and of 0.1 m"):
        match_features(rooms(), dataclasses.replace(rooms(), resolution=0.1))
