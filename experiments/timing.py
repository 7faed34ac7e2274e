"""Milliseconds per scan of several filters, measured side by side."""

import json
from collections.abc import Callable, Sequence

import jax
import numpy as np

from experiments.harness import Options
from jaxslam.preparation import Prepared
from jaxslam.run import run_log


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
    if path.exists() and not options.fresh:
        kept = json.loads(path.read_text())
        if set(kept) == set(names):
            return kept
    ready = {name: prepare(name) for name in names}
    taken: dict[str, list[float]] = {name: [] for name in names}
    # The first round compiles.
    for _ in range(1 + (1 if options.smoke else 5)):
        for name, prepared in ready.items():
            taken[name].append(run_log(prepared.slam, jax.random.key(0), prepared.inputs).ms_per_scan)
    times = {name: float(np.median(values[1:])) for name, values in taken.items()}
    path.write_text(json.dumps(times, indent=1) + "\n")
    return times
