"""Flags of an experiment, cells that are computed once and kept, and tables."""

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
        seeds: number of seeds, which start at 0.
        workers: number of processes that run in parallel.
        smoke: whether to run a tiny version, as a check that the experiment runs.
        fresh: whether to compute cells again that the folder already has.
        command: the command that gives the same results, for the record.
    """

    out: Path
    seeds: int
    workers: int
    smoke: bool
    fresh: bool
    command: str = ""


def parse_options(name: str, question: str, seeds: int, arguments: Sequence[str] | None = None) -> Options:
    """Read the flags; the defaults run the full experiment.

    Args:
        name: name of the experiment, a package of `experiments`.
        question: the question that the experiment answers, one line.
        seeds: number of seeds of the full experiment.
        arguments: the arguments without the program's name; None takes the arguments of the process.
    """
    parser = argparse.ArgumentParser(
        prog=f"python -m experiments.{name}",
        description=question,
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    folder = Path(__file__).parents[1] / name / "results"
    parser.add_argument("--out", type=Path, default=folder, help="folder for tables, figures and raw results")
    parser.add_argument("--seeds", type=int, default=seeds, help="runs of each cell, seeds 0 to SEEDS - 1")
    parser.add_argument(
        "--workers", type=int, default=2, help="parallel processes; timings are measured afterwards"
    )
    parser.add_argument(
        "--smoke", action="store_true", help="take minutes instead of hours: two seeds, short drives"
    )
    parser.add_argument("--fresh", action="store_true", help="recompute cells that the folder already has")
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
        name: stem of the file's name.
        settings: every setting that determines the result.
    """

    name: str
    settings: Mapping[str, Any]

    @property
    def digest(self) -> str:
        """Hash of the settings."""
        text = json.dumps(self.settings, sort_keys=True, default=str)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


def compute(cells: Sequence[Cell], work: Callable[[Cell], Arrays], options: Options) -> dict[str, Arrays]:
    """Return the results of all cells by name, and compute only the cells that the folder lacks.

    An interrupted run therefore resumes. At the end, `cells.json` has the settings of all cells.

    Args:
        cells: cells with different names.
        work: a module-level function that computes one cell; each call runs in a new process.
        options: the folder, and the number of processes.
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
            # Otherwise hours of other cells would pass before the error is reported.
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
    """Write `cells.json`: the settings of each cell on one line, with the digest that `raw` has."""
    lines = (f"{json.dumps(cell.name)}: {json.dumps(_record(cell), default=str)}" for cell in cells)
    (folder / "cells.json").write_text("{\n" + ",\n".join(lines) + "\n}\n")


def _record(cell: Cell) -> dict[str, Any]:
    return {"digest": cell.digest, "settings": dict(cell.settings)}


def _apart(work: Callable[[Cell], Arrays], cell: Cell) -> Arrays:
    # A process that ends returns its memory to the system: some cells need gigabytes.
    context = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(1, mp_context=context) as process:
        return process.submit(work, cell).result()


def _keep(folder: Path, cell: Cell, arrays: Arrays) -> None:
    # The settings are written last: a cell without settings is computed again.
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
    """Stack the arrays of the seeds along a new first axis; `one_…` arrays are the first seed's alone."""
    stacked = {name: np.stack([row[name] for row in rows]) for name in rows[0] if not name.startswith("one_")}
    return stacked | {name: value for name, value in rows[0].items() if name.startswith("one_")}


def markdown_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows]) + "\n"


def spread_over_seeds(values: np.ndarray, digits: int = 3, scale: float = 1.0) -> str:
    """Return `mean ± std (worst)` over seeds; the largest value is the worst."""
    scaled = np.asarray(values, float) * scale
    return f"{scaled.mean():.{digits}f} ± {scaled.std():.{digits}f} ({scaled.max():.{digits}f})"


def write_results(options: Options, text: str, duration: float) -> None:
    """Write the tables and their origin into the folder, and print the tables.

    The files have no date, so that equal results give equal bytes.

    Args:
        options: the folder and the command.
        text: the tables, Markdown.
        duration: length of a drive, seconds.
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
