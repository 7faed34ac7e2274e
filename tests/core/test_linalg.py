"""Closed-form 3 × 3 systems against NumPy."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxslam.core.linalg import inverse_symmetric, solve_symmetric


def random_matrices(count, condition):
    random = np.random.default_rng(0)
    rotations = np.linalg.qr(random.normal(size=(count, 3, 3)))[0]
    eigenvalues = np.stack(
        [np.full(count, 1.0), random.uniform(0.1, 1, count), np.full(count, 1 / condition)]
    )
    return np.einsum("nij,jn,nkj->nik", rotations, eigenvalues, rotations)


def test_inverse_and_solution_are_numpys():
    matrices, vectors = random_matrices(50, 100.0), np.random.default_rng(1).normal(size=(50, 3))
    inverses = jax.vmap(inverse_symmetric)(jnp.asarray(matrices, jnp.float32))
    # A product of three entries near 1 is off by 3e-7, and dividing by a determinant down to 1e-3 makes
    # that 3e-4 of an inverse whose entries reach 100.
    np.testing.assert_allclose(inverses, np.linalg.inv(matrices), rtol=1e-3, atol=0.05)
    solutions = jax.vmap(solve_symmetric)(
        jnp.asarray(matrices, jnp.float32), jnp.asarray(vectors, jnp.float32)
    )
    np.testing.assert_allclose(solutions, np.linalg.solve(matrices, vectors[..., None])[..., 0], atol=0.1)


def test_only_the_upper_triangle_is_read():
    matrix = np.array([[4.0, 1.0, 0.5], [1.0, 3.0, -0.2], [0.5, -0.2, 2.0]])
    upper = jnp.asarray(np.triu(matrix), jnp.float32)
    np.testing.assert_allclose(inverse_symmetric(upper), np.linalg.inv(matrix), rtol=1e-5)
    vector = np.array([1.0, -2.0, 3.0])
    found = solve_symmetric(upper, jnp.asarray(vector, jnp.float32))
    np.testing.assert_allclose(found, np.linalg.solve(matrix, vector), rtol=1e-5)
