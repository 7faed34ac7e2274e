"""`materialize` changes when a table is computed, and nothing else."""

import functools

import chex
import jax
import jax.numpy as jnp
import numpy as np

from jaxslam.xla.materialize import materialize
from tests.checks import assert_strongly_typed


def table_of(values):
    return jnp.cumsum(jnp.sin(values))


class MaterializeTest(chex.TestCase):
    @chex.variants(with_jit=True, without_jit=True)
    def test_it_returns_what_the_function_returns(self):
        values = jnp.linspace(0.0, 3.0, 50)
        found = self.variant(functools.partial(materialize, table_of))(values)
        np.testing.assert_allclose(found, table_of(values), rtol=1e-6)
        assert_strongly_typed(found)


def test_types_and_pytrees_pass_through():
    operand = (jnp.arange(4, dtype=jnp.uint8), jnp.asarray([True, False, True, True]))
    found = materialize(lambda pair: jnp.where(pair[1], pair[0], jnp.uint8(9)), operand)
    assert found.dtype == jnp.uint8
    np.testing.assert_array_equal(found, [0, 9, 2, 3])


def test_it_batches():
    values = jnp.linspace(0.0, 3.0, 60).reshape(3, 20)
    together = jax.jit(jax.vmap(lambda v: materialize(table_of, v)))(values)
    np.testing.assert_allclose(together, jax.vmap(table_of)(values), rtol=1e-6)
