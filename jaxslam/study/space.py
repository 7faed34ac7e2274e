"""The search space of a study: named settings, each with an interval or with choices."""

import dataclasses
import itertools
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import Any

from jaxslam.config.dotted import KIND, Scalar, flatten, update
from jaxslam.config.slam import METHODS, SlamConfig
from jaxslam.core.names import did_you_mean

METHOD = "method"
VALUES_OF_A_SIZE = 5
"""Number of values of a setting that changes the compiled program, unless the space gives it a step or a
logarithmic scale."""


@dataclass(frozen=True)
class Parameter:
    """One dimension of the search space.

    Attributes:
        name: dotted name, as in `jaxslam config`, or `method`.
        choices: the choices; empty for an interval.
        low: lower end of the interval, included.
        high: upper end of the interval, included.
        step: distance between values; None if they are continuous.
        log: whether the scale is logarithmic.
        whole: whether the values are whole numbers.
    """

    name: str
    choices: tuple[Scalar, ...] = ()
    low: float = 0.0
    high: float = 0.0
    step: float | None = None
    log: bool = False
    whole: bool = False

    @property
    def chooses_a_part(self) -> bool:
        """Return whether some other parameters may exist only for some of its choices."""
        return _chooses_a_part(self.name)

    def ends(self) -> tuple[Scalar, ...]:
        """Return all choices, or both ends of the interval."""
        number = int if self.whole else float
        return self.choices or (number(self.low), number(self.high))

    def suggest(self, trial: Any) -> Scalar:
        """Return the sampler's value for an Optuna trial."""
        if self.choices:
            return trial.suggest_categorical(self.name, self.choices)
        if self.whole:
            step = 1 if self.step is None else int(self.step)
            return trial.suggest_int(self.name, int(self.low), int(self.high), step=step, log=self.log)
        return trial.suggest_float(self.name, self.low, self.high, step=self.step, log=self.log)

    def __str__(self) -> str:
        if self.choices:
            return f"{self.name}: {', '.join(map(str, self.choices))}"
        scale = " on a logarithmic scale" if self.log else ""
        steps = "" if self.step is None else f" in steps of {self.step:g}"
        return f"{self.name}: {self.low:g} to {self.high:g}{steps}{scale}"


@dataclass(frozen=True)
class Space:
    """A search space; parameters that choose a part of the filter come first."""

    parameters: tuple[Parameter, ...]

    @classmethod
    def from_tables(cls, tables: Mapping[str, Any], base: SlamConfig) -> "Space":
        """Read and check a space.

        Args:
            tables: `[choice, …]` or `{low, high, step, log}` or `{choices}` by name.
            base: the configuration that provides all other settings.

        Raises:
            ValueError: an empty space, an unknown name (a match is suggested), or an invalid interval.
        """
        if not tables:
            raise ValueError(
                'the space is empty: give [space] some settings, such as "sensor.sigma_hit" = '
                "{ low = 0.02, high = 0.3, log = true }"
            )
        # The choice of a part determines which other names exist.
        names = sorted(tables, key=lambda name: not _chooses_a_part(name))
        known: dict[str, Scalar] = {METHOD: next(iter(METHODS))}
        before = known | flatten(base)
        parts = [
            _parameter(name, tables[name], before)
            for name in names
            if _chooses_a_part(name) and name in before
        ]
        for choice in _combinations(parts):
            known |= flatten(with_settings(base, choice))
        for name in names:
            if name not in known:
                hint = f"{did_you_mean(name, known)}`jaxslam config` prints the settings"
                raise ValueError(f"space: no setting is called {name!r}: {hint}")
        chosen = {parameter.name for parameter in parts}
        rest = [_parameter(name, tables[name], known) for name in names if name not in chosen]
        if METHOD in tables and "proposal.kind" in tables:
            raise ValueError("space: method also sets proposal.kind: give only one of the two")
        return cls((*parts, *rest))

    def parts(self) -> list[Parameter]:
        """Return the parameters that choose a part of the filter."""
        return [parameter for parameter in self.parameters if parameter.chooses_a_part]

    def suggest(self, trial: Any, base: SlamConfig) -> dict[str, Scalar]:
        """Suggest a trial's settings: first the parts, then the settings of those parts."""
        settings = {parameter.name: parameter.suggest(trial) for parameter in self.parts()}
        known = flatten(with_settings(base, settings))
        for parameter in self.parameters:
            if not parameter.chooses_a_part and parameter.name in known:
                settings[parameter.name] = parameter.suggest(trial)
        return settings

    def where_it_applies(self, parameter: Parameter, base: SlamConfig) -> dict[str, Scalar]:
        """Return choices of parts with which a filter has this parameter."""
        if parameter.chooses_a_part:
            return {}
        choices = _combinations(self.parts())
        return next(choice for choice in choices if parameter.name in flatten(with_settings(base, choice)))

    def with_steps(self, is_size: Callable[[Parameter], bool]) -> "Space":
        """Return the space with at most `VALUES_OF_A_SIZE` values for each size with a linear scale."""

        def limited(parameter: Parameter) -> Parameter:
            if parameter.choices or parameter.step is not None or parameter.log or not is_size(parameter):
                return parameter
            step = float((_exact(parameter.high) - _exact(parameter.low)) / (VALUES_OF_A_SIZE - 1))
            if parameter.whole:
                step = max(1, math.ceil(step))
            return dataclasses.replace(parameter, step=step, high=_last(parameter.low, parameter.high, step))

        return Space(tuple(limited(parameter) for parameter in self.parameters))


def with_settings(configuration: SlamConfig, settings: Mapping[str, Scalar]) -> SlamConfig:
    """Return a configuration with changed settings; `method` is one of them."""
    rest = dict(settings)
    if METHOD in rest:
        configuration = configuration.with_method(str(rest.pop(METHOD)))
    return update(configuration, rest, exact=True)


def _chooses_a_part(name: str) -> bool:
    return name == METHOD or name.endswith("." + KIND)


def _parameter(name: str, table: Any, known: Mapping[str, Scalar]) -> Parameter:
    where, value = f"space: {name}", known[name]
    if isinstance(table, list):
        table = {"choices": table}
    if not isinstance(table, Mapping):
        raise ValueError(f"{where} is {table!r}: give a list of choices or {{ low = …, high = … }}")
    if "choices" in table:
        choices = table["choices"]
        if len(table) > 1 or not isinstance(choices, list) or not choices:
            raise ValueError(f"{where}: give a list of choices without other keys")
        for choice in choices:
            if not isinstance(choice, bool | int | float | str):
                raise ValueError(f"{where}: {choice!r} is not a choice: give numbers, text, true or false")
            if choices.count(choice) > 1:
                raise ValueError(f"{where}: {choice!r} is given twice among the choices")
        return Parameter(name, choices=tuple(choices))
    unknown = [key for key in table if key not in ("low", "high", "step", "log")]
    if unknown:
        raise ValueError(f"{where} has no {unknown[0]!r}: there are low, high, step, log and choices")
    if isinstance(value, bool | str):
        raise ValueError(f"{where} is not a number: give a list of choices")
    if not {"low", "high"} <= set(table):
        raise ValueError(f"{where}: give low and high")
    for key in ("low", "high", "step"):
        number = table.get(key, 0)
        # An int may be too large for a float.
        if type(number) not in (int, float) or not abs(number) <= sys.float_info.max:
            raise ValueError(f"{where}: {key} is {number!r}: give a finite number")
        if isinstance(value, int) and not isinstance(number, int):
            raise ValueError(f"{where}: {key} is {number!r}: give a whole number")
    low, high, step, log = table["low"], table["high"], table.get("step"), table.get("log", False)
    if not low < high:
        raise ValueError(f"{where}: low is {low} and high is {high}: low must be less")
    if step is not None and not 0 < step <= high - low:
        raise ValueError(f"{where}: step is {step}: give more than 0, and no more than high - low")
    if not isinstance(log, bool) or (log and (low <= 0 or step is not None)):
        raise ValueError(f"{where}: log needs an interval above 0 and no step")
    if step is not None:
        high = _last(low, high, step)
    return Parameter(name, (), low, high, step, log, isinstance(value, int))


def _last(low: float, high: float, step: float) -> float:
    """Return the largest value of an interval that is a whole number of steps above its lower end."""
    last = _exact(low) + (_exact(high) - _exact(low)) // _exact(step) * _exact(step)
    return int(last) if isinstance(low, int) and isinstance(step, int) else float(last)


def _exact(number: float) -> Decimal:
    """Return a number as written in decimal: in binary, ten times 0.1 is not 1."""
    return Decimal(str(number))


def _combinations(parts: Sequence[Parameter]) -> Iterator[dict[str, Scalar]]:
    names = [parameter.name for parameter in parts]
    for values in itertools.product(*(parameter.choices for parameter in parts)):
        yield dict(zip(names, values, strict=True))
