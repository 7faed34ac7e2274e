"""Multinomial resampling: N independent draws."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from jaxslam.resampling._fixed_point import cumulative_weights, pick
from jaxslam.resampling._selection import select_ancestors
from jaxslam.resampling.base import AbstractResampler


class MultinomialResampler(AbstractResampler):
    """N independent draws from the weights: the textbook scheme, with the highest variance.

    References:
        Gordon, Salmond, Smith 1993.
    """

    def ancestors(self, key: PRNGKeyArray, log_weights: Float[Array, "N"]) -> Int[Array, "N"]:
        """Return indices `[N]` (int32), in no order; see `AbstractResampler.ancestors`."""

        def choose(weights):
            cumulative = cumulative_weights(weights)
            positions = jax.random.randint(
                key, weights.shape, jnp.uint32(0), cumulative[-1], dtype=jnp.uint32
            )
            return pick(cumulative, positions)

        return select_ancestors(log_weights, choose)
