"""Permutation of ancestors that leaves survivors in their slots."""

import jax.numpy as jnp
from jaxtyping import Array, Int


def keep_survivors_in_place(ancestors: Int[Array, "N"]) -> Int[Array, "N"]:
    """Permute ancestors `[N]` so that every particle with a child keeps its own slot.

    The counts stay the same, so the resampled set is the same set. Slot `i` of the result is `i` for every
    survivor `i`; the free slots take the surplus copies, both in ascending order. The map, which is the
    large part of a particle, is then copied into the free slots only.

    Args:
        ancestors: `[N]` indices in [0, N), in any order.

    Returns:
        `[N]` int32.

    Example:
        `[1, 1, 1, 3]`: 1 and 3 survive, slots 0 and 2 are free, two copies of 1 are surplus: `[1, 1, 1, 3]`.
        `[0, 0, 1, 1]` becomes `[0, 1, 0, 1]`.
    """
    count = ancestors.shape[0]
    slots = jnp.arange(count, dtype=jnp.int32)
    children = jnp.zeros(count, jnp.int32).at[ancestors].add(1)
    survives = children > 0
    surplus_until = jnp.cumsum(jnp.where(survives, children - 1, 0), dtype=jnp.int32)
    # The d-th free slot takes the d-th surplus copy; their numbers are equal.
    dead_before = jnp.cumsum(~survives, dtype=jnp.int32) - 1
    parent_of_dead = jnp.searchsorted(surplus_until, dead_before, side="right").astype(jnp.int32)
    return jnp.where(survives, slots, parent_of_dead)
