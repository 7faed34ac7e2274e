"""Survivors keep their slots: properties of random ancestors, and a loop as oracle."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.resampling import keep_survivors_in_place

reorder_batch = jax.jit(jax.vmap(keep_survivors_in_place))


def by_loop(ancestors) -> list[int]:
    counts = np.bincount(ancestors, minlength=len(ancestors))
    surplus = [i for i, c in enumerate(counts) for _ in range(max(c - 1, 0))]
    return [i if c > 0 else surplus.pop(0) for i, c in enumerate(counts)]


def random_ancestors(rng, count, kind):
    if kind == "uniform":
        return rng.integers(0, count, count)
    if kind == "few parents":
        return rng.choice(rng.integers(0, count, 2), count)
    if kind == "skewed":
        return np.minimum((count * rng.random(count) ** 4).astype(int), count - 1)
    return rng.permutation(count)


@pytest.mark.parametrize("kind", ["uniform", "few parents", "skewed", "permutation"])
@pytest.mark.parametrize("count", [1, 2, 3, 5, 16, 101])
def test_properties(kind, count):
    rng = np.random.default_rng(count)
    batch = np.stack([random_ancestors(rng, count, kind) for _ in range(200)])
    reordered = reorder_batch(jnp.asarray(batch, jnp.int32))
    assert reordered.dtype == jnp.int32
    for before, after in zip(batch, np.asarray(reordered), strict=True):
        np.testing.assert_array_equal(np.sort(after), np.sort(before))
        survivors = np.unique(before)
        np.testing.assert_array_equal(after[survivors], survivors)
        np.testing.assert_array_equal(after, by_loop(before))
        # As few slots as can be are written: one for each particle that died.
        assert (after != np.arange(count)).sum() == count - len(survivors)


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_every_ancestor_vector_of_a_small_set(count):
    batch = np.stack(np.meshgrid(*[np.arange(count)] * count, indexing="ij"), -1)
    batch = batch.reshape(-1, count)
    assert len(batch) == count**count
    reordered = reorder_batch(jnp.asarray(batch, jnp.int32))
    np.testing.assert_array_equal(reordered, [by_loop(row) for row in batch])


def test_worked_examples_of_the_docstring():
    for before, after in (([1, 1, 1, 3], [1, 1, 1, 3]), ([0, 0, 1, 1], [0, 1, 0, 1])):
        found = keep_survivors_in_place(jnp.asarray(before, jnp.int32))
        np.testing.assert_array_equal(found, after)


def test_it_is_idempotent_and_blind_to_order():
    rng = np.random.default_rng(0)
    ancestors = jnp.asarray(rng.integers(0, 64, 64), jnp.int32)
    once = keep_survivors_in_place(ancestors)
    np.testing.assert_array_equal(keep_survivors_in_place(once), once)
    shuffled = jnp.asarray(rng.permutation(np.asarray(ancestors)), jnp.int32)
    np.testing.assert_array_equal(keep_survivors_in_place(shuffled), once)


def test_a_hundred_thousand_particles():
    rng = np.random.default_rng(1)
    ancestors = rng.integers(0, 100_000, 100_000)
    after = np.asarray(jax.jit(keep_survivors_in_place)(jnp.asarray(ancestors, jnp.int32)))
    np.testing.assert_array_equal(after, by_loop(ancestors))


def test_output_is_strongly_typed_int32():
    shape = jax.eval_shape(keep_survivors_in_place, jnp.zeros(3, jnp.int32))
    assert (shape.dtype, shape.weak_type) == (jnp.int32, False)
