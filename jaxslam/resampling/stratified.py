"""Stratified resampling: one random position in each of N equal strata."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from jaxslam.resampling._fixed_point import pick_per_stratum
from jaxslam.resampling._selection import select_ancestors
from jaxslam.resampling.base import AbstractResampler


class StratifiedResampler(AbstractResampler):
    """Positions (k + u_k) / N with independent u_k; each count is within two of N w.

    The variance never exceeds that of multinomial resampling, for any estimate. The draws are independent,
    as convergence proofs require; those of systematic resampling are not.

    References:
        Kitagawa 1996; Douc, Cappé, Moulines 2005, Comparison of resampling schemes.
    """

    def ancestors(self, key: PRNGKeyArray, log_weights: Float[Array, "N"]) -> Int[Array, "N"]:
        """Return indices `[N]` (int32), ascending; see `AbstractResampler.ancestors`."""
        offsets = jax.random.uniform(key, log_weights.shape, jnp.float32)
        return select_ancestors(log_weights, lambda weights: pick_per_stratum(weights, offsets))
