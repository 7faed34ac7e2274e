"""Where cells lie."""

import jax.numpy as jnp
import numpy as np

from jaxslam.grid import GridSpec


def test_covering_takes_whole_cells_and_covers_the_box():
    spec = GridSpec.covering(np.array([-1.0, 2.0]), np.array([0.95, 3.0]), 0.1)
    assert (spec.height, spec.width) == (10, 20)
    np.testing.assert_allclose(spec.origin, [-1.0, 2.0])
    point = GridSpec.covering(np.zeros(2), np.zeros(2), 0.1)
    assert (point.height, point.width) == (1, 1)


def test_cells_count_columns_along_x_and_rows_along_y():
    spec = GridSpec(jnp.float32(0.5), jnp.asarray([-1.0, 2.0], jnp.float32), height=3, width=8)
    points = jnp.asarray([[-1.0, 2.0], [0.25, 2.75]], jnp.float32)
    np.testing.assert_allclose(spec.cells(points), [[0.0, 0.0], [2.5, 1.5]])
    np.testing.assert_allclose(spec.cells(points[1]), [2.5, 1.5])
