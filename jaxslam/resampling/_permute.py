"""Permutation of ancestors that leaves survivors in their slots."""

import jax.numpy as jnp
from jaxtyping import Array, Int


def keep_survivors_in_place(ancestors: Int[Array, "N"]) -> Int[Array, "N"]:
    """Permute ancestors `[N]` so that every particle with a child keeps its own slot.

    The counts stay the same, and therefore the resampled set. Slot `i` of the result is `i` for every
    survivor `i`; the slots of discarded particles take the surplus copies, both in ascending order. Maps,
    the largest part of a particle, are then copied only into these slots.

    Args:
        ancestors: `[N]` indices in [0, N), in any order.

    Returns:
        `[N]` int32.

    Example:
        `[1, 1, 1, 3]` stays the same: 1 and 3 survive, and the slots 0 and 2 take the two surplus copies
        of 1. `[0, 0, 1, 1]` becomes `[0, 1, 0, 1]`.
    """
    count = ancestors.shape[0]
    slots = jnp.arange(count, dtype=jnp.int32)
    children = jnp.zeros(count, jnp.int32).at[ancestors].add(1)
    survives = children > 0
    surplus_until = jnp.cumsum(jnp.where(survives, children - 1, 0), dtype=jnp.int32)
    # The d-th discarded slot takes the d-th surplus copy; both have the same number.
    dead_before = jnp.cumsum(~survives, dtype=jnp.int32) - 1
    parent_of_dead = jnp.searchsorted(surplus_until, dead_before, side="right").astype(jnp.int32)
    return jnp.where(survives, slots, parent_of_dead)
