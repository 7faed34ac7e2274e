"""Residual resampling: the integer part of N · w is deterministic, the rest is drawn."""

import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from jaxslam.resampling._fixed_point import pick, pick_at_random
from jaxslam.resampling._selection import select_ancestors
from jaxslam.resampling.base import AbstractResampler


class ResidualResampler(AbstractResampler):
    """⌊N w⌋ copies of each particle, then multinomial draws from the remaining weights.

    References:
        Liu, Chen 1998, Sequential Monte Carlo methods for dynamic systems.

    Example:
        With weights 0.5, 0.3, 0.2 and N = 4, two copies of particle 0 and one of particle 1 are certain. The
        fourth slot goes to particle 1 with probability 0.2 and to particle 2 with probability 0.8.
    """

    def ancestors(self, key: PRNGKeyArray, log_weights: Float[Array, "N"]) -> Int[Array, "N"]:
        """Return indices `[N]` (int32): the certain copies ascending, then the draws in no order."""
        return select_ancestors(log_weights, lambda weights: _choose(key, weights))


def _choose(key: PRNGKeyArray, weights: Float[Array, "N"]) -> Int[Array, "N"]:
    expected = weights * (weights.shape[0] / jnp.sum(weights))
    certain = jnp.floor(expected)
    remainder = expected - certain
    # Without a remainder, no slot uses the draws; a remainder of ones only keeps them defined.
    remainder = jnp.where(jnp.any(remainder > 0.0), remainder, jnp.ones_like(remainder))
    slots = jnp.arange(weights.shape[0], dtype=jnp.uint32)
    copies = jnp.cumsum(certain.astype(jnp.uint32), dtype=jnp.uint32)
    return jnp.where(slots < copies[-1], pick(copies, slots), pick_at_random(key, remainder))
