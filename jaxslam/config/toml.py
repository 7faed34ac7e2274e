"""Configurations as TOML files in which a comment explains every setting."""

import textwrap
import tomllib
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from equinox import Module

from jaxslam.config.dotted import KIND, Tree, descriptions, flatten, update
from jaxslam.config.slam import SlamConfig
from jaxslam.core.names import optional_import


@optional_import()
def dumps(configuration: Module) -> str:
    """Return every setting as TOML text, each under a comment with its meaning and unit."""
    import tomlkit  # With the command-line extra only.

    document = tomlkit.document()
    meanings = descriptions(configuration)
    for name, value in flatten(configuration).items():
        *parents, key = name.split(".")
        table: Any = document
        for parent in parents:
            if parent not in table:
                table.add(tomlkit.nl())
                table.add(parent, tomlkit.table())
            table = table[parent]
        # Whether a setting is static does not matter to the author of a file.
        meaning = meanings[name].replace(" (static)", "").replace("(static, ", "(")
        for line in textwrap.wrap(meaning, 98):
            table.add(tomlkit.comment(line))
        table.add(key, value)
    return tomlkit.dumps(document)


def save(path: str | Path, configuration: Module) -> None:
    """Write a configuration; `load` returns an equal one.

    Raises:
        OSError: the file cannot be written.
    """
    Path(path).write_text(dumps(configuration), encoding="utf-8")


def read_settings(path: str | Path) -> dict[str, object]:
    """Read the values of a TOML file by dotted name, without checking them against a configuration.

    Raises:
        ValueError: the file is missing or not TOML; the one-line message has the position.
        OSError: the file cannot be read.
    """
    return named(read_tables(path, "a configuration in TOML, as `jaxslam config > FILE` writes it"))


def read_tables(path: str | Path, wanted: str) -> dict[str, Any]:
    """Read a TOML file; errors are as for `read_settings`, and ask for the `wanted` kind of file."""
    try:
        return tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ValueError(f"{path}: no such file: check the path, or give {wanted}") from None
    except UnicodeDecodeError:
        raise ValueError(f"{path}: not a text file: give {wanted}") from None
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{path}: not valid TOML: {error}") from None


def load(path: str | Path, base: SlamConfig | None = None) -> SlamConfig:
    """Read a configuration; settings missing from the file are taken from `base` (None: the defaults).

    Raises:
        ValueError: the file is not TOML, or a name or value in it is invalid; one line.
        OSError: the file cannot be read.
    """
    return apply(path, read_settings(path), SlamConfig() if base is None else base)


def named(table: Mapping[str, object], leaves: Collection[str] = (), prefix: str = "") -> dict[str, object]:
    """Flatten nested tables to dotted names; choices of parts come before their settings.

    Args:
        table: nested tables, as parsed from TOML.
        leaves: keys that mark a table as a value instead of a part of the configuration.
        prefix: prefix of all names.
    """
    found: list[tuple[str, object]] = []
    for key, value in table.items():
        inner = isinstance(value, Mapping) and not any(leaf in value for leaf in leaves)
        found += named(value, leaves, f"{prefix}{key}.").items() if inner else [(prefix + key, value)]  # type: ignore[arg-type]
    return dict(sorted(found, key=lambda item: not item[0].endswith(KIND)))


def apply(path: str | Path, values: Mapping[str, object], base: Tree) -> Tree:
    """Return `base` updated with the values read from a file; errors start with the file's name."""
    try:
        return update(base, values, exact=True)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
