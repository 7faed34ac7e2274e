"""`run_if`: a branch for the batch as a whole."""

import chex
import jax
import jax.numpy as jnp
import numpy as np

from jaxslam.xla.control_flow import run_if


def double(value):
    return jax.tree.map(lambda leaf: 2 * leaf, value)


class RunIfTest(chex.TestCase):
    @chex.variants(with_jit=True, without_jit=True)
    def test_one_member(self):
        operand = {"a": jnp.arange(3.0), "b": jnp.int32(5)}
        run = self.variant(lambda p, x: run_if(p, double, x))
        chex.assert_trees_all_equal(run(jnp.asarray(True), operand), double(operand), strict=True)
        chex.assert_trees_all_equal(run(jnp.asarray(False), operand), operand, strict=True)


def test_members_of_a_batch_choose_for_themselves():
    predicates = jnp.asarray([True, False, True, False])
    values = jnp.arange(4.0) + 1.0
    result = jax.jit(jax.vmap(lambda p, x: run_if(p, double, x)))(predicates, values)
    np.testing.assert_array_equal(result, [2.0, 2.0, 6.0, 4.0])


def test_a_batch_that_needs_nothing_runs_nothing():
    trips = []

    def counted(value):
        jax.debug.callback(lambda _: trips.append(1), value)
        return value + 1.0

    run = jax.jit(jax.vmap(lambda p, x: run_if(p, counted, x)))
    jax.block_until_ready(run(jnp.zeros(3, bool), jnp.zeros(3)))
    jax.effects_barrier()
    assert trips == []
    jax.block_until_ready(run(jnp.asarray([False, True, False]), jnp.zeros(3)))
    jax.effects_barrier()
    assert trips
