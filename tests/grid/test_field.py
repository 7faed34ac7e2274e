"""The field of a whole map against SciPy's distance transform, up to the edges and beyond."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from tests.builders import field_of


@pytest.mark.parametrize(("shape", "radius"), [((1, 1), 4), ((5, 9), 10), ((31, 18), 1), ((31, 18), 10)])
def test_distances_are_exact_everywhere_even_off_the_map(shape, radius):
    random = np.random.default_rng(3)
    occupied = random.random(shape) < 0.1
    occupied[0, 0] = occupied[-1, -1] = True
    resolution, origin = 0.1, np.array([-3.0, 12.0])
    field = field_of(occupied, origin, resolution, radius)
    assert field.fine.radius == radius

    around = 15
    wide = np.pad(occupied, around)
    truth = np.minimum(np.round(distance_transform_edt(~wide) ** 2), radius**2 + 1)
    rows, columns = np.indices(wide.shape) - around
    centers = origin + resolution * (np.stack([columns, rows], axis=-1).reshape(-1, 2) + 0.5)
    found = field.fine.squared_distance(jnp.asarray(centers, jnp.float32)) / resolution**2
    np.testing.assert_allclose(found, truth.ravel(), rtol=1e-4)


def test_coarse_level_sees_every_obstacle():
    occupied = np.zeros((13, 22), bool)
    occupied[0, 0] = occupied[12, 21] = occupied[6, 10] = True
    field = field_of(occupied, resolution=1.0, radius=5)
    centers = np.argwhere(occupied)[:, ::-1] + 0.5
    squared = field.coarse.squared_distance(jnp.asarray(centers, jnp.float32))
    # At most half a coarse diagonal is lost, so the obstacle's own or a neighboring cell is marked.
    assert (np.asarray(squared) <= 2 * 4.0**2).all()
    far = jnp.asarray([[-18.0, -18.0], [40.0, 30.0]], jnp.float32)
    np.testing.assert_allclose(field.coarse.squared_distance(far), 26 * 4.0**2, rtol=1e-6)


def test_radius_out_of_bounds_is_refused():
    with pytest.raises(ValueError, match="radius is 11 cells: choose 1 to 10"):
        field_of(np.zeros((4, 4), bool), radius=11)
