"""The truncated distance transform against SciPy's exact one."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from jaxslam.grid.distance import MAX_RADIUS, margin_rows, squared_distance_flat

transform_flat = jax.jit(squared_distance_flat, static_argnums=2)


@functools.partial(jax.jit, static_argnums=1)
def transform(occupied, radius):
    """With empty columns between the rows, no distance reaches over into the neighboring row."""
    height, width = occupied.shape
    padded = jnp.pad(occupied, ((margin_rows(radius),) * 2, (0, radius))).astype(jnp.int8)
    return squared_distance_flat(padded, jnp.int8(0), radius).reshape(height, width + radius)[:, :width]


def truth(occupied, radius):
    if not occupied.any():
        return np.full(occupied.shape, radius**2 + 1)
    return np.minimum(np.round(distance_transform_edt(~occupied) ** 2), radius**2 + 1)


def test_five_by_five_by_hand():
    occupied = np.zeros((5, 5), bool)
    occupied[2, 1] = True
    expected = [
        [5, 4, 5, 5, 5],
        [2, 1, 2, 5, 5],
        [1, 0, 1, 4, 5],
        [2, 1, 2, 5, 5],
        [5, 4, 5, 5, 5],
    ]
    np.testing.assert_array_equal(transform(jnp.asarray(occupied), 2), expected)


@pytest.mark.parametrize(
    ("shape", "radius"),
    [((1, 1), 1), ((1, 40), 5), ((30, 2), 4), ((33, 41), 1), ((33, 41), 6), ((33, 41), 10)],
)
def test_random_maps(shape, radius):
    random = np.random.default_rng(radius)
    for share_occupied in (0.0, 0.003, 0.02, 0.3, 1.0):
        occupied = random.random(shape) < share_occupied
        found = transform(jnp.asarray(occupied), radius)
        assert found.dtype == jnp.uint8
        np.testing.assert_array_equal(found, truth(occupied, radius))


@pytest.mark.parametrize("radius", [2, 10])
def test_flat_rows_are_right_but_for_the_documented_columns(radius):
    random = np.random.default_rng(5)
    margin, width = margin_rows(radius), 48
    occupied = random.random((20 + 2 * margin, width)) < 0.01
    found = np.asarray(transform_flat(jnp.asarray(occupied, jnp.int8), jnp.int8(0), radius)).reshape(
        20, width
    )
    # The margins are read, so the rows next to them see the obstacles there.
    expected = truth(occupied, radius)[margin:-margin]
    np.testing.assert_array_equal(found[:, radius:-radius], expected[:, radius:-radius])


def test_under_vmap_nothing_changes():
    occupied = jnp.asarray(np.random.default_rng(0).random((3, 33, 41)) < 0.02)
    together = jax.jit(jax.vmap(lambda cells: transform(cells, 6)))(occupied)
    for one, alone in zip(together, occupied, strict=True):
        np.testing.assert_array_equal(one, transform(alone, 6))


@pytest.mark.parametrize("radius", [0, -1, MAX_RADIUS + 1])
def test_radius_out_of_bounds_is_refused(radius):
    with pytest.raises(ValueError, match=f"radius is {radius} cells: choose 1 to 10"):
        squared_distance_flat(jnp.zeros((30, 30), jnp.int8), jnp.int8(0), radius)
