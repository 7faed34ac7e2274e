"""A branch that stays a branch under `vmap`."""

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

T = TypeVar("T")


def run_if(predicate: Bool[Array, ""], function: Callable[[T], T], operand: T) -> T:
    """Return `function(operand)` where `predicate` holds, else `operand`.

    Under `vmap`, `lax.cond` becomes a select that always runs both sides. A `while_loop` with at most one
    iteration runs for the whole batch if any member needs it, and is skipped if none does.
    """

    def once(carry: tuple[Array, T]) -> tuple[Array, T]:
        return jnp.zeros_like(carry[0]), function(carry[1])

    return jax.lax.while_loop(lambda carry: carry[0], once, (predicate, operand))[1]
