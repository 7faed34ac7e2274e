"""Parameter checks of a model, run when the model is created."""

import math
from collections.abc import Callable

import equinox as eqx


def require_at_least_zero(model: eqx.Module, positive: tuple[str, ...] = ()) -> None:
    """Raise `ValueError` if a parameter is negative, or if one named in `positive` is zero.

    Only Python numbers are checked, because the value of a traced array is unknown.
    """
    for name, value in vars(model).items():
        if not isinstance(value, int | float):
            continue
        if name in positive and not value > 0.0:
            raise ValueError(f"{type(model).__name__}: {name} is {value}, must be > 0")
        if not value >= 0.0:
            raise ValueError(f"{type(model).__name__}: {name} is {value}, must be >= 0")


def require_odd(model: eqx.Module, *names: str) -> None:
    """Raise `ValueError` for an even count: only an odd count has a middle element."""
    for name in names:
        if getattr(model, name) % 2 == 0:
            raise ValueError(f"{type(model).__name__}: {name} is {getattr(model, name)}, must be odd")


def require_one_of(model: eqx.Module, name: str, choices: tuple[str, ...]) -> None:
    """Raise `ValueError` if the value is not one of the choices."""
    value = getattr(model, name)
    if value not in choices:
        raise ValueError(f"{type(model).__name__}: {name} is {value!r}, must be one of {', '.join(choices)}")


def require_number(module: eqx.Module, name: str, holds: Callable[[float], bool], wanted: str) -> None:
    """Raise `ValueError` if a settings number is not finite or fails `holds`. Traced values are skipped."""
    value = getattr(module, name)
    if isinstance(value, float) and not (math.isfinite(value) and holds(value)):
        part = type(module).__name__.removesuffix("Settings").lower()
        raise ValueError(f"{part}.{name} is {value}: give {wanted}")
