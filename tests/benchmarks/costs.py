"""What compiled programs cost by XLA's own count, against a committed baseline.

    python -m tests.benchmarks.costs        # from the repository's root: writes the baseline anew

Flops and bytes accessed come from `compiled.cost_analysis()`, temporary and output bytes from
`compiled.memory_analysis()`. They are the same on every machine with the same XLA: neither the number of
cores nor the vector instructions of a CPU change them. So what shows here is a change of the program, which
no clock on a busy machine could tell.

What they are not: a time, or the work of a whole run. XLA counts the body of a loop once, however often it
runs, so iterations and scans are not in there, and of a branch that is rarely taken all of it. A flop is
whatever the analysis counts as one, comparisons and conversions included, and "accessed" is what the
operations read and write, caches or not. Temporary bytes are real: the memory that a call takes besides its
arguments and results.
"""

import functools
import json
import platform
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jaxlib

from jaxslam.config.slam import METHODS
from tests.benchmarks.batches import still_runs
from tests.benchmarks.corrections import corrections
from tests.benchmarks.filters import still_filter, still_run
from tests.benchmarks.localizers import localization_step, sensor_model
from tests.benchmarks.programs import Program
from tests.benchmarks.stages import STAGES

BASELINE = Path(__file__).with_name("costs.json")
RENEW = "python -m tests.benchmarks.costs"
NUM_PARTICLES, NUM_SCANS = 15, 8


class Bounds(NamedTuple):
    """What a cost may become.

    Attributes:
        factor: so many times what it was.
        slack: flops, or bytes, that it may change by in any case.
    """

    factor: float
    slack: float


SAME_COMPILER = Bounds(1.1, 1024.0)
"""Of a cost of almost nothing the factor says nothing."""
OTHER_COMPILER = Bounds(1.5, 131072.0)
"""Another jaxlib, if only the next patch, brings another XLA, which fuses and counts in other ways. From
0.8.0 to 0.10.2 the costs of whole methods moved by one per cent, but from 0.10.1 to 0.10.2 the temporary
bytes of `score` went from 41 to 81 kB, and those of a range correction from 1 to 37 kB. So this catches what
got out of hand, and only in what costs megabytes."""

Costs = dict[str, float]


def _stage(name: str) -> Program:
    return STAGES[name](*still_filter(NUM_PARTICLES))


PROGRAMS: dict[str, Callable[[], Program]] = {
    **{f"stage {name}": functools.partial(_stage, name) for name in STAGES if name != "step"},
    **{f"method {name}": functools.partial(still_run, name, NUM_PARTICLES, NUM_SCANS) for name in METHODS},
    # Of the filter that compiles the fastest: what is run many times has its costs above.
    "run many": functools.partial(still_runs, "rbpf", NUM_PARTICLES, NUM_SCANS, 4),
    "localization sensor model": functools.partial(sensor_model, 500, 60),
    "localization step": functools.partial(localization_step, 500, 60),
    "range correction": functools.partial(corrections, 180, 1),
}
"""Everything that is timed, at one small size; a whole step is the loop of `method gmapping`."""


def count(program: Program) -> Costs:
    """The costs of a program, compiled for the CPU."""
    # The count is made before there is machine code: a rough draft of that takes a third of the time.
    compiled = program.lowered(xla_backend_optimization_level=0).compile()
    analysis, memory = compiled.cost_analysis(), compiled.memory_analysis()
    return {
        "flops": float(analysis.get("flops", 0.0)),
        "bytes_accessed": float(analysis.get("bytes accessed", 0.0)),
        "temporary_bytes": float(memory.temp_size_in_bytes),
        "output_bytes": float(memory.output_size_in_bytes),
    }


def compiler() -> dict[str, str]:
    """What decides the costs besides the program: XLA comes with jaxlib."""
    return {"jax": jax.__version__, "jaxlib": jaxlib.__version__, "architecture": platform.machine()}


def complaints(
    name: str, now: Costs, before: Costs, made_by: Mapping[str, str], here: Mapping[str, str]
) -> Iterator[str]:
    """What is out of bounds, a line each.

    Args:
        name: of the program.
        now, before: its costs, and those of the baseline.
        made_by: the baseline's compiler.
        here: this one.
    """
    same = made_by == here
    factor, slack = SAME_COMPILER if same else OTHER_COMPILER
    for figure, value in now.items():
        wanted = before[figure]
        if value - wanted > slack and value > factor * wanted:
            yield (
                f"{name}: {figure} {wanted:.4g} before and {value:.4g} now, over {factor} times as much; "
                f"if it is worth it: {RENEW}"
            )
        # With another compiler less is its doing, and no reason to change anything.
        elif same and wanted - value > slack and wanted > factor * value:
            yield f"{name}: {figure} {wanted:.4g} before, only {value:.4g} now; so that it stays so: {RENEW}"


def read_baseline() -> dict[str, Any]:
    """`compiler`, and the costs in `programs` by name."""
    return json.loads(BASELINE.read_text(encoding="utf-8"))


def main() -> None:
    """Counts everything and writes the baseline."""
    programs = {}
    for name, make in PROGRAMS.items():
        programs[name] = count(make())
        print(name, *(f"{figure} {value:.4g}" for figure, value in programs[name].items()), sep="  ")
    baseline = {"compiler": compiler(), "programs": programs}
    BASELINE.write_text(json.dumps(baseline, indent=1) + "\n", encoding="utf-8")
    print(f"written to {BASELINE}")


if __name__ == "__main__":
    main()
