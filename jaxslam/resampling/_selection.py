"""The common part of all schemes: weights from log-weights, and the identity if no weight is finite."""

from collections.abc import Callable

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxslam.resampling.ess import relative_to_largest


def select_ancestors(log_weights: Float[Array, "N"], choose: Callable) -> Int[Array, "N"]:
    """Return `choose(weights [N]) -> ancestors [N]`, or `arange(N)` if no log-weight is finite.

    The weights passed to `choose` are finite, ≥ 0, and the largest is 1.
    """
    relative, any_usable = relative_to_largest(log_weights)
    identity = jnp.arange(log_weights.shape[0], dtype=jnp.int32)
    return jnp.where(any_usable, choose(jnp.exp(relative)), identity)
