"""Keeping XLA from computing an array anew for every element that is looked up in it."""

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array

T = TypeVar("T")


def computed_once(function: Callable[[T], Array], operand: T) -> Array:
    """`function(operand)`, written to memory before anything reads it.

    On the CPU, XLA fuses the computation of a table into the loop that looks entries up, and so repeats it
    for every look-up. What a branch computes stays in the branch, and its result is a buffer. The barrier
    hides that the branch is always taken; alone it would be of no use, since XLA drops it before it fuses.
    """
    # Traced once, though it is asked for its shape and then called.
    function = jax.jit(function)
    result = jax.eval_shape(function, operand)
    always = jax.lax.optimization_barrier(jnp.asarray(True))
    return jax.lax.cond(always, function, lambda _: jnp.zeros(result.shape, result.dtype), operand)
