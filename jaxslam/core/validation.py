"""Checks of a model's parameters when it is constructed, and of the arguments of the main functions."""

import dataclasses
import math
import reprlib
from collections.abc import Callable

import equinox as eqx
import jax


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


def require_count(module: eqx.Module, name: str) -> None:
    """Raise `ValueError` unless a setting is a whole number, 1 or more."""
    value = getattr(module, name)
    if not (hasattr(value, "__index__") and value >= 1):
        wanted = "1 or more" if hasattr(value, "__index__") else "a whole number"
        raise ValueError(f"{name} is {value!r}: give {wanted}")


def require_types(function: str, **arguments: tuple[object, type, str]) -> None:
    """Raise `TypeError` for an argument of the wrong type; each is its value, its type and what to give."""
    for name, (value, wanted, remedy) in arguments.items():
        if not isinstance(value, wanted):
            raise TypeError(f"{function}: {name} is of type {type(value).__name__}: give {remedy}")


def require_keys(function: str, keys: object, dimensions: int, example: str) -> None:
    """Raise `TypeError` unless `keys` are PRNG keys, new or old, in an array with these dimensions."""
    if isinstance(keys, jax.Array):
        is_new = jax.dtypes.issubdtype(keys.dtype, jax.dtypes.prng_key)
        if keys.ndim == dimensions + (not is_new) and (is_new or keys.dtype == "uint32"):
            return
    shown = f"{keys.dtype}{list(keys.shape)}" if isinstance(keys, jax.Array) else reprlib.repr(keys)
    raise TypeError(f"{function}: {'keys are' if dimensions else 'key is'} {shown}: give {example}")


def require_static_sizes(module: eqx.Module) -> None:
    """Raise `TypeError` for a size or a choice that is not static, in a module or its parts."""
    for field in dataclasses.fields(module):
        value = getattr(module, field.name)
        if field.type in (bool, int, str, "bool", "int", "str") and not field.metadata.get("static"):
            raise TypeError(
                f"{type(module).__name__}.{field.name} is a size or a choice, but not static: declare it as "
                f"equinox.field(static=True, default={value!r})"
            )
        if isinstance(value, eqx.Module):
            require_static_sizes(value)
