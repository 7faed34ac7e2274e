"""Systematic resampling: N evenly spaced positions with one random offset."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from jaxslam.resampling._fixed_point import pick_per_stratum
from jaxslam.resampling._selection import select_ancestors
from jaxslam.resampling.base import AbstractResampler


class SystematicResampler(AbstractResampler):
    """Positions (k + u) / N with one u for all k; each particle is copied ⌊N w⌋ or ⌈N w⌉ times.

    The usual choice: lowest variance of the counts, one random number, ancestors in ascending order.

    References:
        Kitagawa 1996; Thrun, Burgard, Fox 2005, table 4.4 (low-variance sampler).

    Example:
        Weights 0.5, 0.25, 0.25, N = 3 and u = 0.5 give the positions 1/6, 1/2, 5/6 and ancestors 0, 1, 2.
    """

    def ancestors(self, key: PRNGKeyArray, log_weights: Float[Array, "N"]) -> Int[Array, "N"]:
        """Return indices `[N]` (int32), ascending; see `AbstractResampler.ancestors`."""
        offsets = jnp.full(log_weights.shape, jax.random.uniform(key, (), jnp.float32))
        return select_ancestors(log_weights, lambda weights: pick_per_stratum(weights, offsets))
