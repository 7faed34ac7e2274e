"""Milliseconds per scan of several filters, measured side by side."""

import json
from collections.abc import Callable, Sequence

import jax
import numpy as np

from experiments.harness import Cell, Options
from jaxslam.config.dotted import flatten
from jaxslam.pipeline.prepare import Prepared
from jaxslam.pipeline.run import run_log
from jaxslam.report import versions


def milliseconds_per_scan(
    names: Sequence[str], prepare: Callable[[str], Prepared], options: Options
) -> dict[str, float]:
    """The median of rounds in which all take turns, in one process that has the machine to itself.

    Call it after all else; kept in the results' folder like the cells.

    Args:
        names: of the methods.
        prepare: a method's filter and inputs.
        options: where to, and whether from anew.
    """
    path = options.out / "raw" / "times.json"
    ready = {name: prepare(name) for name in names}
    # Times of other settings, or of another drive, are those of other filters.
    settings = {
        name: {**flatten(prepared.slam), "scans": len(prepared.inputs.stamps)}
        for name, prepared in ready.items()
    }
    cell = Cell("times", {"methods": settings, "versions": versions()})
    if path.exists() and not options.fresh:
        kept = json.loads(path.read_text())
        if kept.get("digest") == cell.digest:
            return kept["times"]
    taken: dict[str, list[float]] = {name: [] for name in names}
    # The first round compiles.
    for _ in range(1 + (1 if options.smoke else 5)):
        for name, prepared in ready.items():
            taken[name].append(run_log(prepared.slam, jax.random.key(0), prepared.inputs).ms_per_scan)
    times = {name: float(np.median(values[1:])) for name, values in taken.items()}
    path.write_text(json.dumps({"digest": cell.digest, "times": times}, indent=1) + "\n")
    return times
