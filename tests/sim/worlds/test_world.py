"""Shapes, clearances, and the built-in and generated halls."""

import jax
import numpy as np
import pytest

from jaxslam.sim import (
    World,
    box,
    disc,
    hall_large,
    hall_small,
    make_world,
    polyline,
    random_hall,
    random_roadway,
    roadway,
)
from jaxslam.sim.worlds.world import leg_clearances


def segments_of(world: World) -> np.ndarray:
    return np.asarray(world.segments, np.float64)


def test_box_is_a_closed_loop_of_known_corners() -> None:
    np.testing.assert_array_equal(
        box((1.0, 2.0), (2.0, 4.0)),
        [[0, 0, 2, 0], [2, 0, 2, 4], [2, 4, 0, 4], [0, 4, 0, 0]],
    )


def test_box_turned_by_a_quarter_swaps_its_sides() -> None:
    turned = box((0.0, 0.0), (2.0, 4.0), angle=np.pi / 2)
    np.testing.assert_allclose(turned[0], [2, -1, 2, 1], atol=1e-12)


def test_chamfer_cuts_the_corners() -> None:
    cut = box((0.0, 0.0), (2.0, 2.0), chamfer=0.25)
    assert cut.shape == (8, 4)
    lengths = np.linalg.norm(cut[:, 2:] - cut[:, :2], axis=1)
    # Sides 2 − 2·0.25, corners 0.25·√2.
    np.testing.assert_allclose(np.sort(lengths), [0.25 * 2**0.5] * 4 + [1.5] * 4)


def test_disc_lies_on_its_circle_and_closes() -> None:
    round_ = disc((1.0, 1.0), 0.5, sides=8)
    np.testing.assert_allclose(np.linalg.norm(round_[:, :2] - 1.0, axis=1), 0.5)
    np.testing.assert_array_equal(round_[:, 2:], np.roll(round_[:, :2], -1, axis=0))


def test_leg_clearances_by_hand() -> None:
    walls = polyline(np.array([[0.0, 3.0], [10.0, 3.0]]))
    tour = np.array([[0.0, 0.0], [10.0, 1.0], [10.0, 4.0]])
    # First leg: its end is 2 m below the wall. Second: touches the wall's end. Third: crosses it.
    np.testing.assert_allclose(leg_clearances(walls, tour), [2.0, 0.0, 0.0], atol=1e-12)


def test_leg_clearances_sees_a_crossing_far_from_all_ends() -> None:
    wall = polyline(np.array([[0.0, -5.0], [0.0, 5.0]]))
    np.testing.assert_array_equal(leg_clearances(wall, np.array([[-5.0, 0.0], [5.0, 0.0]])), [0, 0])


@pytest.mark.parametrize(("builder", "size"), [(hall_small, (18, 15)), (hall_large, (24, 23))])
def test_halls_have_the_size_of_paper_1(builder, size) -> None:
    world, _ = builder()
    lower, upper = world.bounds()
    np.testing.assert_array_equal(lower, [0, 0])
    np.testing.assert_array_equal(upper, size)


@pytest.mark.parametrize("name", ["hall_small", "hall_large"])
def test_halls_are_not_self_similar(name: str) -> None:
    """Turned by half a turn, or mirrored, a hall does not look like itself."""
    world, _ = make_world(name)
    assert world.name == name
    middles = segments_of(world).reshape(-1, 2, 2).mean(axis=1)
    size = world.bounds()[1]
    for flip in ([True, True], [True, False], [False, True]):
        moved = np.where(flip, size - middles, middles)
        gaps = np.linalg.norm(moved[:, None] - middles[None], axis=-1).min(axis=1)
        assert (gaps > 0.2).mean() > 0.5


@pytest.mark.parametrize("seed", range(20))
def test_random_halls_are_valid(seed: int) -> None:
    world, tour = random_hall(jax.random.key(seed))
    lower, upper = world.bounds()
    np.testing.assert_allclose(lower, 0, atol=1e-6)
    assert 16 <= upper[0] <= 24
    assert 14 <= upper[1] <= 22
    # Room for the default robot (0.3 m) and its steering (0.2 m), with some to spare.
    assert leg_clearances(segments_of(world), tour).min() > 0.6
    reference, reference_tour = random_hall(jax.random.key(100))
    assert world.segments.shape == reference.segments.shape
    assert tour.shape == reference_tour.shape


def test_random_halls_follow_their_key() -> None:
    first, again, other = (random_hall(jax.random.key(seed))[0] for seed in (5, 5, 6))
    np.testing.assert_array_equal(first.segments, again.segments)
    assert not np.array_equal(first.segments, other.segments)


def test_the_roadway_is_long_and_its_loop_clear() -> None:
    world, tour = roadway()
    lower, upper = world.bounds()
    assert upper[0] - lower[0] == pytest.approx(71, abs=0.5)
    assert np.linalg.norm(np.roll(tour, -1, axis=0) - tour, axis=1).sum() > 150
    assert leg_clearances(np.asarray(world.segments, float), tour).min() > 1.2
    again = roadway()[0]
    np.testing.assert_array_equal(world.segments, again.segments)


def test_the_roadway_looks_alike_along_its_drifts() -> None:
    """Legs of supports stand every 1.5 m on both sides; that is what makes it hard."""
    legs = np.asarray(roadway()[0].segments)
    legs = legs[np.linalg.norm(legs[:, 2:] - legs[:, :2], axis=1) < 0.17]
    assert len(legs) / 4 > 150


@pytest.mark.parametrize("seed", range(5))
def test_random_roadways_are_valid(seed: int) -> None:
    world, tour = random_roadway(jax.random.key(seed))
    assert leg_clearances(np.asarray(world.segments, float), tour).min() > 0.8
    other, _ = random_roadway(jax.random.key(seed + 100))
    assert not np.array_equal(world.bounds()[1], other.bounds()[1])


def test_unknown_world_names_the_nearest() -> None:
    with pytest.raises(ValueError, match=r"'hall_smal'.*'hall_small'"):
        make_world("hall_smal")


def test_worlds_without_segments_or_with_broken_ones_are_refused() -> None:
    with pytest.raises(ValueError, match="no segment"):
        World.from_shapes("empty", [])
    with pytest.raises(ValueError, match="not finite"):
        World.from_shapes("broken", [np.array([[0.0, 0.0, np.nan, 1.0]])])
    with pytest.raises(ValueError, match=r"1 segments without length.*\[2.0, 3.0\]"):
        World.from_shapes("point", [np.array([[2.0, 3.0, 2.0, 3.0], [0.0, 0.0, 1.0, 0.0]])])
