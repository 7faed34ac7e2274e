"""Adaptive resampling: resample only when the weights have degenerated."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from jaxslam.core.validation import require_at_least_zero
from jaxslam.resampling.base import AbstractResampler
from jaxslam.resampling.ess import effective_sample_size, normalize


class Resampling(eqx.Module):
    """Result of one resampling decision.

    Attributes:
        ancestors: `[N]` int32, the particle that each slot continues; `arange(N)` without resampling.
        log_weights: `[N]` normalized log-weights afterwards; −log N after resampling.
        resampled: whether resampling took place.
        ess: effective sample size of the incoming weights, between 1 and N.
    """

    ancestors: Int[Array, "N"]
    log_weights: Float[Array, "N"]
    resampled: Bool[Array, ""]
    ess: Float[Array, ""]


class AdaptiveResampling(eqx.Module):
    """Resampling with a scheme when the effective sample size falls below `threshold · N`.

    If no weight is finite, the set is kept, with uniform weights and `resampled` false.

    Attributes:
        scheme: resampling scheme that chooses the ancestors.
        threshold: fraction of N, ≥ 0; 0 never resamples, a value above 1 always does.

    References:
        Liang et al. (16), Yang et al. 2019 (17), Jamaludin et al. (2): resample when N_eff < N/2.
    """

    scheme: AbstractResampler
    threshold: float | Float[Array, ""] = 0.5

    def __check_init__(self):
        require_at_least_zero(self)

    def __call__(self, key: PRNGKeyArray, log_weights: Float[Array, "N"]) -> Resampling:
        """Resample from log-weights `[N]`, which need not be normalized, if they have degenerated."""
        count = log_weights.shape[0]
        ess = effective_sample_size(log_weights)
        resampled = (ess < self.threshold * count) & jnp.any(jnp.isfinite(log_weights))
        ancestors = jax.lax.cond(
            resampled,
            lambda: self.scheme.ancestors(key, log_weights),
            lambda: jnp.arange(count, dtype=jnp.int32),
        )
        kept, uniform = normalize(log_weights), normalize(jnp.zeros_like(log_weights))
        return Resampling(ancestors, jnp.where(resampled, uniform, kept), resampled, ess)
