"""Configurations as named scalars: the common mechanism behind flags, TOML and `--set`.

A configuration is a tree of frozen dataclasses, and so is a filter. Its scalars have dotted names, such as
`proposal.fine.sigma_cells`. A part that can be chosen from several classes also has a `kind`, such as
`proposal.kind`. Names are derived from the fields, so a new field needs no code here. Arrays and devices are
not settings.
"""

import dataclasses
import difflib
import math
from collections.abc import Callable, Iterator, Mapping
from types import UnionType
from typing import Any, TypeVar

from jaxslam.config.registry import VARIANTS, build, choices, kind

Scalar = bool | int | float | str
Tree = TypeVar("Tree")
KIND = "kind"
UNSET = "unset"
"""Metadata key of a field that may be None: changing one of its settings starts from this part."""


def flatten(tree: object) -> dict[str, Scalar]:
    """Return every scalar of a configuration by its dotted name, in the order of the fields."""
    return {name: value for name, value, _ in _walk(tree, "")}


def descriptions(tree: object) -> dict[str, str]:
    """Return the meaning of each scalar, from the `Attributes:` of the docstrings; empty if undocumented."""
    return {name: text for name, _, text in _walk(tree, "", explain=True)}


def update(tree: Tree, changes: Mapping[str, object], *, exact: bool = False) -> Tree:
    """Return a configuration with several scalars changed at once.

    Choices (`proposal.kind`, or `proposal` for short) are applied first. A part of a new class starts from
    the defaults of that class, so the other changes can name the fields of the new class.

    Args:
        tree: the configuration.
        changes: new values by dotted name.
        exact: require full names; otherwise names can be abbreviated to any unambiguous suffix.

    Raises:
        ValueError: a name is unknown or ambiguous (the message suggests the closest match), or a value has
            the wrong type, is not finite, or is out of range.
    """
    rest = dict(changes)
    while chosen := next(((name, full) for name in rest if (full := _choice(tree, name, exact))), None):
        given, full = chosen
        tree = _rebuild(tree, {full: rest.pop(given)}, "")
    resolved: dict[str, object] = {}
    for name, value in rest.items():
        known = _resolve(name, [full for full, _, _ in _walk(tree, "", fill=True)], exact)
        if known in resolved:
            raise ValueError(f"{known} is given twice, once as {name}: give it once")
        resolved[known] = value
    return _rebuild(tree, resolved, "")


def parse_assignment(text: str) -> tuple[str, Scalar]:
    """Return name and value of `name=value`, as given to `--set`.

    Example:
        `parse_assignment("num_particles=50")` is `("num_particles", 50)`.

    Raises:
        ValueError: the name or the `=` is missing.
    """
    name, equals, value = (part.strip() for part in text.partition("="))
    if not (name and equals and value):
        raise ValueError(f"--set {text!r} is not name=value, such as --set sensor.sigma_hit=0.1")
    return name, parse_scalar(value)


def parse_scalar(text: str) -> Scalar:
    """Return a command-line value: a whole number, a number, true or false, else text."""
    if text in ("true", "false"):
        return text == "true"
    for number in (int, float):
        try:
            return number(text)
        except ValueError:
            continue
    return text


def _walk(
    tree: object, prefix: str, declared: object = None, *, fill: bool = False, explain: bool = False
) -> Iterator[tuple[str, Scalar, str]]:
    meanings = _attributes(type(tree)) if explain else {}
    # A field declared with a concrete class is not a choice, even if that class is a registered variant.
    if declared in VARIANTS:
        names = ", ".join(choices(tree))
        yield prefix + KIND, kind(tree), f"one of {names}, or module:Class for a class of your own"
    fields = dataclasses.fields(tree)  # type: ignore[arg-type]
    # Scalars come first: in TOML they would otherwise belong to the table of the previous part.
    for field in fields:
        value = getattr(tree, field.name)
        if _is_scalar(value):
            yield prefix + field.name, _plain(value, field.type), meanings.get(field.name, "")
    for field in fields:
        value = getattr(tree, field.name)
        if value is None and fill:
            value = field.metadata.get(UNSET)
        if dataclasses.is_dataclass(value):
            yield from _walk(value, f"{prefix}{field.name}.", field.type, fill=fill, explain=explain)


def _is_scalar(value: object) -> bool:
    return isinstance(value, bool | int | float | str) or getattr(value, "ndim", None) == 0


def _plain(value: Any, annotation: object) -> Scalar:
    return value if annotation in (int, bool, str) else float(value)


def _attributes(class_: type) -> dict[str, str]:
    """Return the `Attributes:` section of a Google-style docstring, one line of text per name."""
    from docstring_parser.google import parse  # With the command-line extra only.

    return {
        name: " ".join((entry.description or "").split())
        for entry in parse(class_.__doc__ or "").params
        for name in entry.arg_name.split(", ")
    }


def _choice(tree: object, name: str, exact: bool) -> str | None:
    """Return the full name of the `kind` that a name refers to, or None."""
    kinds = [full for full in flatten(tree) if full.endswith("." + KIND)]
    for wanted in (name, f"{name}.{KIND}"):
        fits = [full for full in kinds if full == wanted or (not exact and full.endswith("." + wanted))]
        if len(fits) == 1:
            return fits[0]
    return None


def _resolve(name: str, names: list[str], exact: bool) -> str:
    if name in names:
        return name
    fits = [] if exact else [full for full in names if full.endswith("." + name)]
    if len(fits) == 1:
        return fits[0]
    if fits:
        raise ValueError(f"{name!r} could be {', '.join(fits)}: give more of the name")
    raise ValueError(
        f"no setting is called {name!r}: did you mean {_nearest(name, names)!r}? "
        "`jaxslam config` prints the settings of `run`; `config.toml` in a run folder has those of that run"
    )


def _nearest(name: str, names: list[str]) -> str:
    def likeness(full: str) -> float:
        parts = full.split(".")
        endings = (".".join(parts[start:]) for start in range(len(parts)))
        return max(difflib.SequenceMatcher(None, name, ending).ratio() for ending in endings)

    return max(names, key=likeness)


def _rebuild(tree: Any, changes: Mapping[str, object], prefix: str) -> Any:
    """Return the tree with the named scalars replaced; parts without a change stay the same objects."""
    new: dict[str, object] = {}
    for field in dataclasses.fields(tree):
        name, value = prefix + field.name, getattr(tree, field.name)
        if value is None and any(change.startswith(name + ".") for change in changes):
            value = field.metadata.get(UNSET)
        if dataclasses.is_dataclass(value):
            part = _chosen(value, name, changes)
            part = _rebuild(part, changes, name + ".")
            if part is not getattr(tree, field.name):
                new[field.name] = part
        elif name in changes:
            new[field.name] = _converted(name, changes[name], field.type)
    return dataclasses.replace(tree, **new) if new else tree


def _chosen(part: object, name: str, changes: Mapping[str, object]) -> object:
    wanted = changes.get(f"{name}.{KIND}")
    if wanted is None or wanted == kind(part):
        return part
    try:
        return build(part, str(wanted))
    except ValueError as error:
        raise ValueError(f"{name} is {wanted!r}: {error}") from None


def _converted(name: str, value: object, annotation: object) -> Scalar:
    """Return a value in the type of its field; check it against `_REQUIREMENTS`."""
    for wanted, holds in _REQUIREMENTS.get(annotation, _REQUIREMENTS[float]).items():
        if not holds(value):
            raise ValueError(f"{name} is {value!r}: give {wanted}")
    return _plain(value, annotation)


def _is_of(value: object, numbers: type | UnionType) -> bool:
    return isinstance(value, numbers) and not isinstance(value, bool)


_REQUIREMENTS: dict[object, dict[str, Callable[[Any], bool]]] = {
    str: {"text": lambda value: isinstance(value, str)},
    bool: {"true or false": lambda value: isinstance(value, bool)},
    # Every count (particles, beams, cells, iterations) is at least 1.
    int: {"a whole number": lambda value: _is_of(value, int), "1 or more": lambda value: value >= 1},
    float: {"a number": lambda value: _is_of(value, int | float), "a finite number": math.isfinite},
}
