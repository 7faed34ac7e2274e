"""Distances, free space and frames of a known map, upright and turned."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.grid.known_map import KnownMap
from jaxslam.io import OccupancyMap
from tests.builders import room

ORIGINS = {"upright": (1.0, -2.0, 0.0), "turned": (1.0, -2.0, 0.7), "upside down": (0.0, 0.0, np.pi)}


def test_map_has_a_border_of_nothing():
    known = KnownMap.from_map(room(), max_distance=2.0)
    distance = np.asarray(known.distance)
    assert distance.shape == (8, 10)
    assert (distance[[0, -1]] == 2.0).all()
    assert (distance[:, [0, -1]] == 2.0).all()
    # The middle of the room: cell (2, 3) is two cells from the lower wall.
    assert distance[3, 4] == pytest.approx(1.0)
    assert distance[1, 1] == 0.0


@pytest.mark.parametrize("origin", ORIGINS.values(), ids=ORIGINS.keys())
def test_free_poses_are_free_and_cover_all(origin):
    known = KnownMap.from_map(room(origin=origin))
    poses = known.draw_free(jax.random.key(0), 4000)
    assert bool(jnp.all(jax.vmap(known.is_free)(poses)))
    cells = np.floor(np.asarray(known.to_cells(poses))[:, :2]).astype(int)
    found, counts = np.unique(cells, axis=0, return_counts=True)
    assert len(found) == 23
    # 23 cells, 174 each: six deviations of a binomial either way.
    assert counts.min() > 174 - 6 * np.sqrt(174)
    assert counts.max() < 174 + 6 * np.sqrt(174)
    heading = np.histogram(np.asarray(poses)[:, 2], bins=8, range=(-np.pi, np.pi))[0]
    assert heading.min() > 500 - 6 * np.sqrt(500)


def test_a_turned_map_turns_the_world():
    known = KnownMap.from_map(room(origin=(1.0, -2.0, np.pi / 2)))
    # A meter along the map's x axis is one up in the world.
    cells = known.to_cells(jnp.asarray([[1.0, -1.0, np.pi / 2]], jnp.float32))
    np.testing.assert_allclose(cells, [[2.0, 0.0, 0.0]], atol=1e-5)


@pytest.mark.parametrize(
    ("point", "free"), [((1.2, 1.2), True), ((0.2, 0.2), False), ((-1.0, 1.0), False), ((9.0, 1.0), False)]
)
def test_free_or_not(point, free):
    known = KnownMap.from_map(room())
    assert bool(known.is_free(jnp.asarray([*point, 0.3], jnp.float32))) == free


def test_maps_that_nobody_can_be_in_are_refused():
    cells = np.zeros((3, 3), bool)
    with pytest.raises(ValueError, match="no occupied cell"):
        KnownMap.from_map(OccupancyMap(cells, ~cells, 0.1, np.zeros(3)))
    with pytest.raises(
        ValueError, match="no free cell among its 3 × 3 cells, so there is no place for the robot"
    ):
        KnownMap.from_map(OccupancyMap(~cells, cells, 0.1, np.zeros(3)))
