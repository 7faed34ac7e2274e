"""Weights as integers, whose running sum is exact.

A parallel float32 running sum is not monotone: over 100 000 weights, half of them zero, one stepped down
409 times and changed at 809 particles of weight zero, which could then be picked. The weights are
therefore scaled to add up to about 2³¹ and rounded; integer sums are exact in any order. A count then
departs from N · w by at most N · 2⁻³², 2.3e-5 for 100 000 particles, and by the rounding of w.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float, Int, UInt

_SCALE = 2.0**31


def cumulative_weights(weights: Float[Array, "N"]) -> UInt[Array, "N"]:
    """Return the running sum `[N]` (uint32) of finite weights `[N]` ≥ 0, not all 0; its last is the total."""
    units = jnp.round(weights * (_SCALE / jnp.sum(weights))).astype(jnp.uint32)
    return jnp.cumsum(units, dtype=jnp.uint32)


def stratum_positions(cumulative: UInt[Array, "N"], offsets: Float[Array, "N"]) -> UInt[Array, "N"]:
    """Return positions (k + offset_k) · total / N for k = 0 … N − 1, in units; offsets `[N]` in [0, 1)."""
    total, count = cumulative[-1], cumulative.shape[0]
    whole, rest = total // jnp.uint32(count), total % jnp.uint32(count)
    index = jnp.arange(count, dtype=jnp.uint32)
    # k · total overflows 32 bits. The whole part fits; the rest is below N, so float32 is precise enough.
    slope = rest.astype(jnp.float32) / count
    width = total.astype(jnp.float32) / count
    start = index * whole + (index.astype(jnp.float32) * slope).astype(jnp.uint32)
    position = start + (offsets.astype(jnp.float32) * width).astype(jnp.uint32)
    return jnp.minimum(position, total - jnp.uint32(1))


def pick(cumulative: UInt[Array, "N"], positions: UInt[Array, "M"]) -> Int[Array, "M"]:
    """Return the index `[M]` (int32) of the particle whose share of the total contains each position.

    Positions lie below the total, so an index is always below N and its weight is never zero.
    """
    index = jnp.searchsorted(cumulative, positions, side="right")
    return jnp.minimum(index.astype(jnp.int32), cumulative.shape[0] - 1)
