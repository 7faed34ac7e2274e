"""What the experiments share: their flags, cells that are computed once and kept, tables."""

import argparse
import concurrent.futures
import hashlib
import json
import multiprocessing
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from jaxslam.report import versions

Arrays = dict[str, np.ndarray]


@dataclass(frozen=True)
class Options:
    """The flags of an experiment.

    Attributes:
        out: folder for the results.
        seeds: how many, from 0 on.
        workers: processes that run side by side.
        smoke: a tiny version, to see that it runs.
        fresh: compute again what the folder has.
        command: that gives the same results, for the record.
    """

    out: Path
    seeds: int
    workers: int
    smoke: bool
    fresh: bool
    command: str = ""


def parse_options(name: str, question: str, seeds: int, arguments: Sequence[str] | None = None) -> Options:
    """Reads the flags; the defaults are the full experiment.

    Args:
        name: of the experiment, a package here.
        question: that it answers, one line.
        seeds: of the full experiment.
        arguments: without the program's name; None takes those of the process.
    """
    parser = argparse.ArgumentParser(
        prog=f"python -m experiments.{name}",
        description=question,
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    folder = Path(__file__).parent / name / "results"
    parser.add_argument("--out", type=Path, default=folder, help="folder for tables, figures and raw results")
    parser.add_argument("--seeds", type=int, default=seeds, help="runs of every cell, seeds 0 to SEEDS - 1")
    parser.add_argument(
        "--workers", type=int, default=2, help="processes side by side; timings come after them"
    )
    parser.add_argument(
        "--smoke", action="store_true", help="seconds instead of hours: two seeds, short drives"
    )
    parser.add_argument("--fresh", action="store_true", help="compute again what the folder has")
    given = parser.parse_args(arguments)
    if given.seeds < 1 or given.workers < 1:
        parser.error("--seeds and --workers must be 1 or more")
    if given.smoke and given.out.resolve() == folder.resolve():
        parser.error("--smoke needs --out: it must not overwrite the full results")
    flags = "--smoke --out DIR" if given.smoke else f"--seeds {given.seeds}"
    return Options(
        out=given.out,
        seeds=2 if given.smoke else given.seeds,
        workers=given.workers,
        smoke=given.smoke,
        fresh=given.fresh,
        command=f"{parser.prog} {flags}",
    )


@dataclass(frozen=True)
class Cell:
    """One piece of work, whose result is kept in a file.

    Attributes:
        name: of the file.
        settings: all that decides the result, and goes into it.
    """

    name: str
    settings: Mapping[str, Any]

    @property
    def digest(self) -> str:
        """Changes with the settings."""
        text = json.dumps(self.settings, sort_keys=True, default=str)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


def compute(cells: Sequence[Cell], work: Callable[[Cell], Arrays], options: Options) -> dict[str, Arrays]:
    """The results of all cells by name; what the folder has already is read from there.

    A run that was broken off goes on where it was. At the end `cells.json` has the settings of them all.

    Args:
        cells: with different names.
        work: a function of a module, computes one cell in a process of its own.
        options: where to, and how many at a time.
    """
    raw = options.out / "raw"
    raw.mkdir(parents=True, exist_ok=True)
    missing = [cell for cell in cells if options.fresh or _kept(raw, cell) is None]
    with concurrent.futures.ThreadPoolExecutor(options.workers) as threads:
        running = {threads.submit(_apart, work, cell): cell for cell in missing}
        done = concurrent.futures.as_completed(running)
        try:
            for future in tqdm(done, total=len(missing), unit="cell", disable=not sys.stderr.isatty()):
                _keep(raw, running[future], future.result())
        except BaseException:
            # Or hours of cells that nobody reads would be computed before the error is seen.
            threads.shutdown(wait=False, cancel_futures=True)
            raise
    results = {}
    for cell in cells:
        kept = _kept(raw, cell)
        assert kept is not None, cell.name
        results[cell.name] = kept
    write_settings(options.out, cells)
    return results


def write_settings(folder: Path, cells: Sequence[Cell]) -> None:
    """Writes what every cell was made from: `cells.json`, a line each, with the digest of `raw`."""
    lines = (f"{json.dumps(cell.name)}: {json.dumps(_record(cell), default=str)}" for cell in cells)
    (folder / "cells.json").write_text("{\n" + ",\n".join(lines) + "\n}\n")


def _record(cell: Cell) -> dict[str, Any]:
    return {"digest": cell.digest, "settings": dict(cell.settings)}


def _apart(work: Callable[[Cell], Arrays], cell: Cell) -> Arrays:
    # A process of its own, which gives its memory back: some cells need gigabytes.
    context = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(1, mp_context=context) as process:
        return process.submit(work, cell).result()


def _keep(folder: Path, cell: Cell, arrays: Arrays) -> None:
    # The settings last: without them the arrays do not count, nor do those of before while these are written.
    (folder / f"{cell.name}.json").unlink(missing_ok=True)
    np.savez_compressed(folder / f"{cell.name}.npz", **arrays)  # type: ignore[arg-type]
    (folder / f"{cell.name}.json").write_text(json.dumps(_record(cell), indent=1, default=str) + "\n")


def _kept(folder: Path, cell: Cell) -> Arrays | None:
    settings, arrays = folder / f"{cell.name}.json", folder / f"{cell.name}.npz"
    if not (settings.exists() and arrays.exists()):
        return None
    if json.loads(settings.read_text())["digest"] != cell.digest:
        return None
    with np.load(arrays) as stored:
        return dict(stored)


def stack_seeds(rows: Sequence[Arrays]) -> Arrays:
    """The arrays of several seeds, seeds first; those named `one_…` are the first seed's alone."""
    stacked = {name: np.stack([row[name] for row in rows]) for name in rows[0] if not name.startswith("one_")}
    return stacked | {name: value for name, value in rows[0].items() if name.startswith("one_")}


def markdown_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows]) + "\n"


def spread_over_seeds(values: np.ndarray, digits: int = 3, scale: float = 1.0) -> str:
    """`mean ± std (worst)` over seeds; the largest is the worst."""
    scaled = np.asarray(values, float) * scale
    return f"{scaled.mean():.{digits}f} ± {scaled.std():.{digits}f} ({scaled.max():.{digits}f})"


def write_results(options: Options, text: str, duration: float) -> None:
    """Writes the tables and what made them, and prints the tables.

    No date: the same results are the same bytes.

    Args:
        options: where to.
        text: the tables, Markdown.
        duration: of a drive, seconds.
    """
    (options.out / "table.md").write_text(text, encoding="utf-8")
    origin = {
        "command": options.command,
        "seeds": options.seeds,
        "duration_s": duration,
        "versions": versions(),
    }
    (options.out / "run.json").write_text(json.dumps(origin, indent=1) + "\n")
    print(text)
    print(f"written to {options.out}")
