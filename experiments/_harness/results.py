"""Read the results of an experiment: its tables, and the command and the versions that made them."""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Table:
    """A table of `table.md`.

    Attributes:
        header: names of the columns; the second column of the same name is `NAME (2)`.
        rows: the cells of each row.
    """

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def row(self, first: Sequence[str]) -> dict[str, str]:
        """Return the row that begins with these cells, by column.

        Raises:
            KeyError: no row begins with them.
        """
        for row in self.rows:
            if row[: len(first)] == tuple(first):
                return dict(zip(self.header, row, strict=True))
        raise KeyError(", ".join(first))


@dataclass(frozen=True)
class Results:
    """The results of an experiment.

    Attributes:
        text: content of `table.md`; None if the experiment has not been completed.
        origin: content of `run.json`; empty if the file does not exist.
    """

    text: str | None
    origin: dict[str, Any]

    @property
    def tables(self) -> dict[str, Table]:
        """Tables by title; the title begins with the heading above the table: `hall_small: Methods`."""
        return {} if self.text is None else _tables(self.text)

    @property
    def made_by(self) -> str:
        """Seeds, drives and versions in one line, as far as `run.json` has them."""
        said = []
        if "seeds" in self.origin:
            said.append(f"{self.origin['seeds']} seeds")
        if "duration_s" in self.origin:
            said.append(f"drives of {self.origin['duration_s']:g} s")
        versions = self.origin.get("versions", {})
        said += [f"{name} {version}" for name, version in versions.items() if name != "platform"]
        return ", ".join(said)


def read_results(folder: Path) -> Results:
    """Read the results of a folder, as far as they exist.

    Raises:
        ValueError: `run.json` is not JSON.
        OSError: a file cannot be read.
    """
    table, origin = folder / "table.md", folder / "run.json"
    text = table.read_text(encoding="utf-8") if table.exists() else None
    try:
        said = json.loads(origin.read_text(encoding="utf-8")) if origin.exists() else {}
    except json.JSONDecodeError as error:
        raise ValueError(f"{origin}: not valid JSON: {error}") from None
    return Results(text, said)


def _tables(text: str) -> dict[str, Table]:
    found, section, title = {}, "", ""
    for block in re.split(r"\n\s*\n", text):
        line = block.strip()
        if line.startswith("#"):
            section = line.lstrip("# ") + ": "
        elif line.startswith("|"):
            found[section + title] = _table(line)
        elif line.endswith(":"):
            title = line[:-1]
    return found


def _table(block: str) -> Table:
    lines = [_cells(line) for line in block.splitlines()]
    # The second line is the rule below the header.
    return Table(_distinct(lines[0]), tuple(lines[2:]))


def _cells(line: str) -> tuple[str, ...]:
    return tuple(cell.strip() for cell in line.strip().strip("|").split("|"))


def _distinct(names: Sequence[str]) -> tuple[str, ...]:
    before = [names[:index].count(name) for index, name in enumerate(names)]
    return tuple(
        f"{name} ({count + 1})" if count else name for name, count in zip(names, before, strict=True)
    )
