"""Checks of a model's parameters when it is constructed."""

import math
from collections.abc import Callable

import equinox as eqx


def require_at_least_zero(model: eqx.Module, positive: tuple[str, ...] = ()) -> None:
    """Raise `ValueError` if a parameter is negative, or is zero and named in `positive`.

    Only Python numbers are checked: the value of a traced array is not available.
    """
    for name, value in vars(model).items():
        # `not value > 0` also rejects NaN.
        if name in positive and isinstance(value, int | float) and not value > 0.0:
            raise ValueError(f"{type(model).__name__}: {name} is {value}, must be > 0")
        if isinstance(value, int | float) and not value >= 0.0:
            raise ValueError(f"{type(model).__name__}: {name} is {value}, must be >= 0")


def require_within(model: eqx.Module, **intervals: tuple[float, float]) -> None:
    """Raise `ValueError` if a parameter lies outside its closed interval; only Python numbers are checked."""
    for name, (low, high) in intervals.items():
        value = getattr(model, name)
        if isinstance(value, int | float) and not low <= value <= high:
            raise ValueError(f"{type(model).__name__}: {name} is {value}, must be {low:g} to {high:g}")


def require_odd(model: eqx.Module, *names: str) -> None:
    """Raise `ValueError` for an even count: only an odd one has a middle element."""
    for name in names:
        if getattr(model, name) % 2 == 0:
            raise ValueError(f"{type(model).__name__}: {name} is {getattr(model, name)}, must be odd")


def require_one_of(model: eqx.Module, name: str, choices: tuple[str, ...]) -> None:
    """Raise `ValueError` if the setting is not one of `choices`."""
    value = getattr(model, name)
    if value not in choices:
        raise ValueError(f"{type(model).__name__}: {name} is {value!r}, must be one of {', '.join(choices)}")


def require_number(module: eqx.Module, name: str, holds: Callable[[float], bool], wanted: str) -> None:
    """Raise `ValueError` if a number of a settings module is not finite or `holds` is false for it.

    Only Python floats are checked: the value of a traced array is not available.
    """
    value = getattr(module, name)
    if isinstance(value, float) and not (math.isfinite(value) and holds(value)):
        part = type(module).__name__.removesuffix("Settings").lower()
        raise ValueError(f"{part}.{name} is {value}: give {wanted}")
