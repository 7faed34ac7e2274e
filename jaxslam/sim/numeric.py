"""Small numeric helpers that the sensor models share."""

import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

# A model's number: a Python float as written, a traced scalar under `jit`.
Scalar = float | Float[Array, ""]


def standard_normal(key: PRNGKeyArray, shape: tuple[int, ...]) -> Float[Array, "..."]:
    """Draw standard normal numbers, once per sensor: compiling a draw costs more than running it."""
    # A flat draw, because three axes take three times as long to compile on a CPU.
    flat = jax.random.normal(key, (math.prod(shape),))
    # Without the barrier, XLA copies the generator into every use.
    return jax.lax.optimization_barrier(flat).reshape(shape)


_Sum = tuple[Float[Array, "K"], Float[Array, "K"]]


def compensated_add(total: Float[Array, "K"], rounding: Float[Array, "K"], value: Float[Array, "K"]) -> _Sum:
    """Make one step of Kahan's sum; return the new total and its rounding error.

    Ten thousand float32 steps of equal size round in the same direction, which adds up to centimeters.
    """
    corrected = value - rounding
    new_total = total + corrected
    return new_total, (new_total - total) - corrected


def running_sum(values: Float[Array, "M K"]) -> Float[Array, "M K"]:
    """Return compensated sums over the leading axis, up to and including each row."""
    zero = jnp.zeros_like(values[0])

    def add(carry: _Sum, row: Float[Array, "K"]) -> tuple[_Sum, Float[Array, "K"]]:
        total, rounding = compensated_add(*carry, row)
        return (total, rounding), total

    return jax.lax.scan(add, (zero, zero), values)[1]
