"""Normalized weights and their effective sample size."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float


def relative_to_largest(log_weights: Float[Array, "N"]) -> tuple[Float[Array, "N"], Bool[Array, ""]]:
    """Return log-weights `[N]` minus the largest, so at most 0, and whether any of them is finite.

    Entries that are not finite become −inf; if none is finite, all become 0.

    Raises:
        ValueError: there are no particles.
    """
    if log_weights.shape[0] == 0:
        raise ValueError("log_weights has length 0: a particle set needs at least one particle")
    usable = jnp.isfinite(log_weights)
    any_usable = jnp.any(usable)
    # Without a finite entry the maximum is −inf, and −inf − (−inf) would be NaN.
    largest = jnp.where(any_usable, jnp.max(jnp.where(usable, log_weights, -jnp.inf)), 0.0)
    shifted = jnp.where(usable, log_weights - largest, -jnp.inf)
    return jnp.where(any_usable, shifted, jnp.zeros_like(shifted)), any_usable


def normalize(log_weights: Float[Array, "N"]) -> Float[Array, "N"]:
    """Return log-weights `[N]` whose weights sum to one.

    Entries that are not finite become −inf; if none is finite, all become −log N.

    Example:
        `normalize([0, log 3])` is `[log 0.25, log 0.75]`; `normalize([nan, 5])` is `[−inf, 0]`.
    """
    relative, _ = relative_to_largest(log_weights)
    return relative - jnp.log(jnp.sum(jnp.exp(relative)))


def effective_sample_size(log_weights: Float[Array, "N"]) -> Float[Array, ""]:
    """Return the effective sample size, between 1 and N: 1 / Σ w̃², w̃ the normalized weights.

    If no log-weight is finite, it is N, as for the uniform weights that `normalize` returns.

    References:
        Liang et al. (16), Yang et al. 2019 (17), Jamaludin et al. (2); Kong, Liu, Wong 1994.

    Example:
        Weights 0.25 and 0.75 give 1 / (0.0625 + 0.5625) = 1.6.
    """
    relative, _ = relative_to_largest(log_weights)
    weights = jnp.exp(relative)
    total = jnp.sum(weights)
    ess = total * total / jnp.sum(weights * weights)
    return jnp.clip(ess, 1.0, float(weights.shape[0]))
