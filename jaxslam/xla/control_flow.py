"""A conditional that skips work under `vmap`."""

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

T = TypeVar("T")


def run_if(predicate: Bool[Array, ""], function: Callable[[T], T], operand: T) -> T:
    """Return `function(operand)` if `predicate` holds, else `operand`.

    `lax.cond` becomes a select under `vmap`, so both sides always run. A loop of at most one iteration
    does not: it runs for the whole batch if any member needs it, and not at all if none does.
    """

    def once(carry: tuple[Array, T]) -> tuple[Array, T]:
        return jnp.zeros_like(carry[0]), function(carry[1])

    return jax.lax.while_loop(lambda carry: carry[0], once, (predicate, operand))[1]
