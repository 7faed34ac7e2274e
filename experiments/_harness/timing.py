"""Milliseconds per scan of several filters, measured in alternation."""

import json
from collections.abc import Callable, Sequence

import jax
import numpy as np

from experiments._harness.harness import Cell, Options
from jaxslam import RBPF, run_log
from jaxslam.config.dotted import flatten
from jaxslam.pipeline.inputs import PreparedScans
from jaxslam.report import versions


def milliseconds_per_scan(
    names: Sequence[str], prepare: Callable[[str], tuple[RBPF, PreparedScans]], options: Options
) -> dict[str, float]:
    """Return the median over rounds in which the methods take turns in one process.

    Call this function last, when no other process of the experiment runs. The times are kept in the folder of
    the results, like the cells.

    Args:
        names: names of the methods.
        prepare: returns the filter and the scans of a method.
        options: the folder, and whether to measure again.
    """
    path = options.out / "raw" / "times.json"
    ready = {name: prepare(name) for name in names}
    # Kept times are valid for the same settings and the same drive only.
    settings = {name: {**flatten(slam), "scans": len(scans.stamps)} for name, (slam, scans) in ready.items()}
    cell = Cell("times", {"methods": settings, "versions": versions()})
    if path.exists() and not options.fresh:
        kept = json.loads(path.read_text())
        if kept.get("digest") == cell.digest:
            return kept["times"]
    taken: dict[str, list[float]] = {name: [] for name in names}
    # The first round compiles.
    for _ in range(1 + (1 if options.smoke else 5)):
        for name, (slam, scans) in ready.items():
            taken[name].append(run_log(slam, scans, jax.random.key(0)).ms_per_scan)
    times = {name: float(np.median(values[1:])) for name, values in taken.items()}
    path.write_text(json.dumps({"digest": cell.digest, "times": times}, indent=1) + "\n")
    return times
