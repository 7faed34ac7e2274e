"""Ray casting against a cell-by-cell walk in NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.grid.raycast import cast
from tests import builders

ANGLES = np.linspace(-np.pi, np.pi, 73)
cast_jit = jax.jit(cast)


def field_of(occupied, origin=(0.0, 0.0), resolution=1.0, radius=3):
    return builders.field_of(occupied, origin, resolution, radius).fine


def walk(occupied, start, angle, max_range):
    """Amanatides and Woo in float64, unit cells: where the ray enters the first occupied cell."""
    direction = np.array([np.cos(angle), np.sin(angle)])
    cell = np.floor(start).astype(int)
    sign = np.where(direction > 0, 1, -1)
    with np.errstate(divide="ignore"):
        per_cell = np.abs(1.0 / direction)
        side = np.where(direction > 0, cell + 1 - start, start - cell)
        crossing = side * per_cell
    travelled, height, width = 0.0, *occupied.shape
    while travelled < max_range and 0 <= cell[0] < width and 0 <= cell[1] < height:
        if occupied[cell[1], cell[0]]:
            return travelled
        axis = int(np.argmin(crossing))
        travelled = crossing[axis]
        crossing[axis] += per_cell[axis]
        cell[axis] += sign[axis]
    return max_range


@pytest.mark.parametrize("radius", [1, 3, 10])
@pytest.mark.parametrize("share_occupied", [0.0, 0.02, 0.2])
def test_ranges_are_those_of_a_walk_from_cell_to_cell(radius, share_occupied):
    random = np.random.default_rng(radius)
    occupied = random.random((31, 44)) < share_occupied
    field = field_of(occupied, radius=radius)
    for _ in range(5):
        start = random.uniform([0, 0], [44, 31])
        pose = jnp.asarray([*start, 0.3], jnp.float32)
        expected = [walk(occupied, np.float64(pose[:2]), 0.3 + angle, 25.0) for angle in ANGLES]
        found = np.asarray(cast_jit(field, pose, jnp.asarray(ANGLES, jnp.float32), 25.0))
        # A ray that passes a corner within a thousandth of a cell may miss it, or with float32 clip it, and
        # then ends elsewhere: with two corners a ray to miss, 0.3 of the 73 rays on average.
        assert np.sum(np.abs(found - expected) > 1e-4) <= 3


def test_five_by_five_by_hand():
    occupied = np.zeros((5, 5), bool)
    occupied[2, 4] = occupied[4, 2] = occupied[0, 0] = True
    angles = jnp.asarray([0.0, np.pi / 2, -3 * np.pi / 4, np.pi, -np.pi / 2], jnp.float32)
    pose = jnp.asarray([2.5, 2.5, 0.0], jnp.float32)
    found = cast_jit(field_of(occupied), pose, angles, 7.0)
    # Center cell to the side of the cell two on; to the corner (1, 1) of cell (0, 0); and out of the map.
    np.testing.assert_allclose(found, [1.5, 1.5, 1.5 * np.sqrt(2), 7.0, 7.0], atol=1e-5)


def test_offset_resolution_and_heading_change_nothing_but_the_frame():
    random = np.random.default_rng(0)
    occupied = random.random((20, 30)) < 0.05
    angles = jnp.asarray(ANGLES + 0.01, jnp.float32)
    plain = cast_jit(field_of(occupied), jnp.asarray([15.3, 10.2, 0.0], jnp.float32), angles, 20.0)
    moved_field = field_of(occupied, origin=(-40.0, 7.0), resolution=0.05)
    pose = jnp.asarray([-40.0 + 15.3 * 0.05, 7.0 + 10.2 * 0.05, 2.0], jnp.float32)
    moved = cast_jit(moved_field, pose, angles - 2.0, 1.0)
    # 40 m in float32 is 4e-6 m, 8e-5 cells; a ray that passes a corner that closely may end elsewhere.
    assert np.mean(np.abs(np.asarray(moved) / 0.05 - np.asarray(plain)) < 2e-3) > 0.97


def test_ends_of_the_range():
    occupied = np.zeros((9, 9), bool)
    occupied[4, 7] = True
    field = field_of(occupied)
    ahead = jnp.zeros(1, jnp.float32)
    inside = jnp.asarray([7.5, 4.5, 0.0], jnp.float32)
    assert float(cast_jit(field, inside, ahead, 5.0)[0]) == 0.0
    before = jnp.asarray([1.5, 4.5, 0.0], jnp.float32)
    assert float(cast_jit(field, before, ahead, 5.6)[0]) == pytest.approx(5.5)
    assert float(cast_jit(field, before, ahead, 5.4)[0]) == pytest.approx(5.4)
    off_map = jnp.asarray([-100.0, 4.5, 0.0], jnp.float32)
    assert float(cast_jit(field, off_map, ahead, 5.0)[0]) == 5.0


def test_beams_that_graze_a_wall_end_within_the_fixed_number_of_trips():
    """Beside a wall every step is a cell; the trips must suffice for the longest line through the map."""
    occupied = np.zeros((8, 400), bool)
    occupied[3, :] = True
    occupied[4:, 399] = True
    field = field_of(occupied, radius=6)
    pose = jnp.asarray([0.5, 4.01, 0.0], jnp.float32)
    found = cast_jit(field, pose, jnp.zeros(1, jnp.float32), 1000.0)
    assert float(found[0]) == pytest.approx(398.5, abs=1e-3)


def test_vmap_and_jit_change_nothing():
    occupied = np.random.default_rng(1).random((20, 30)) < 0.05
    field, angles = field_of(occupied), jnp.asarray(ANGLES, jnp.float32)
    poses = jnp.asarray([[3.2, 4.1, 0.1], [10.3, 11.7, -2.0], [18.8, 2.2, 3.0]], jnp.float32)
    together = jax.jit(jax.vmap(cast, (None, 0, None, None)))(field, poses, angles, 15.0)
    one_by_one = np.stack([cast(field, pose, angles, 15.0) for pose in poses])
    assert np.mean(np.abs(together - one_by_one) < 1e-4) > 0.97
