"""Whether the numbers of a model make sense, looked at when it is made."""

import math
from collections.abc import Callable

import equinox as eqx


def require_at_least_zero(model: eqx.Module, positive: tuple[str, ...] = ()) -> None:
    """Raises `ValueError` for a negative parameter, or one named in `positive` that is zero.

    Only Python numbers are looked at: a traced value cannot be.
    """
    for name, value in vars(model).items():
        if not isinstance(value, int | float):
            continue
        if name in positive and not value > 0.0:
            raise ValueError(f"{type(model).__name__}: {name} is {value}, must be > 0")
        if not value >= 0.0:
            raise ValueError(f"{type(model).__name__}: {name} is {value}, must be >= 0")


def require_odd(model: eqx.Module, *names: str) -> None:
    """Raises `ValueError` for an even count: the middle of what is counted must be one of them."""
    for name in names:
        if getattr(model, name) % 2 == 0:
            raise ValueError(f"{type(model).__name__}: {name} is {getattr(model, name)}, must be odd")


def require_one_of(model: eqx.Module, name: str, choices: tuple[str, ...]) -> None:
    """Raises `ValueError` for a choice that there is not."""
    value = getattr(model, name)
    if value not in choices:
        raise ValueError(f"{type(model).__name__}: {name} is {value!r}, must be one of {', '.join(choices)}")


def require_number(module: eqx.Module, name: str, holds: Callable[[float], bool], wanted: str) -> None:
    """Checks a number of a settings module. A traced one cannot be looked at; NaN never holds."""
    value = getattr(module, name)
    if isinstance(value, float) and not (math.isfinite(value) and holds(value)):
        part = type(module).__name__.removesuffix("Settings").lower()
        raise ValueError(f"{part}.{name} is {value}: give {wanted}")
