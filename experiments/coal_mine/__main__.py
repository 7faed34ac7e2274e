"""`python -m experiments.coal_mine [--smoke]`: run all cells, write the tables and the figures."""

from collections.abc import Sequence

import numpy as np

from experiments._harness.accuracy import ACCURACY_HEADER, accuracy_columns
from experiments._harness.harness import (
    Arrays,
    Cell,
    Options,
    compute,
    markdown_table,
    parse_options,
    spread_over_seeds,
    write_results,
)
from experiments._harness.method import Method
from experiments._harness.timing import milliseconds_per_scan
from experiments.coal_mine import localization, mapping
from experiments.coal_mine.cells import run_cell
from experiments.coal_mine.figures import draw_localization, draw_particles, draw_roadways
from experiments.coal_mine.methods import DRAWN, MAPPED
from jaxslam.config.dotted import flatten

QUESTION = "Does a Gaussian proposal keep the map of a roadway straight, and can a robot localize in it?"
WORLD = "roadway"
DURATION, SMOKE_DURATION = 230.0, 12.0
"""Seconds: the loop of 166 m and a fifth of it again; a few meters for a smoke test."""
TIMED_FOR = 40.0
"""Length of the drive on which the methods are timed, seconds."""
BEFORE, SMOKE_BEFORE = 60, 10
"""Updates for which a robot is tracked before it is kidnapped."""
TASKS = ("tracking", "global", "kidnapped")
SMOKE_TASKS = (("tracking", "built"), ("global", "true"), ("kidnapped", "true"))


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the experiment."""
    options = parse_options("coal_mine", QUESTION, seeds=10, arguments=arguments)
    names = list(DRAWN) if options.smoke else list(MAPPED)
    cells = [_mapping_cell(name, options) for name in names]
    tasks = [(task, which) for task in TASKS for which in ("true", "built")]
    # One built map is enough for a smoke test.
    tasks = [task for task in tasks if not options.smoke or task in SMOKE_TASKS]
    cells += [_localization_cell(task, which, options) for task, which in tasks]
    results = compute(cells, run_cell, options)
    timed_for = min(_duration(options), TIMED_FOR)
    times = milliseconds_per_scan(
        names, lambda name: mapping.prepared(name, WORLD, 0, timed_for)[:2], options
    )
    draw_roadways(options.out / "maps.png", results)
    draw_particles(options.out / "particles.png", results)
    draw_localization(options.out / "localisation.png", results, _before(options))
    mapped = [_mapping_row(MAPPED[name], results[f"map-{name}"], times[name]) for name in names]
    localized = [_localization_row(task, which, results[f"{task}-{which}"]) for task, which in tasks]
    text = f"Mapping:\n\n{markdown_table(MAPPING_HEADER, mapped)}\n"
    text += f"Localisation:\n\n{markdown_table(LOCALIZATION_HEADER, localized)}"
    write_results(options, text, _duration(options))


def _duration(options: Options) -> float:
    return SMOKE_DURATION if options.smoke else DURATION


def _before(options: Options) -> int:
    return SMOKE_BEFORE if options.smoke else BEFORE


def _mapping_cell(name: str, options: Options) -> Cell:
    settings = {
        "world": WORLD,
        "method": name,
        "duration": _duration(options),
        "seeds": options.seeds,
        "configuration": flatten(MAPPED[name].configuration()),
    }
    return Cell(f"map-{name}", settings)


def _localization_cell(task: str, which: str, options: Options) -> Cell:
    settings = {
        "world": WORLD,
        "task": task,
        "map": which,
        "duration": _duration(options),
        "seeds": options.seeds if task == "tracking" else 1 if options.smoke else 5,
        "trials": 1 if task == "tracking" else 2 if options.smoke else 10,
        "before": _before(options),
        "steps": 20 if options.smoke else 150,
        "configuration": flatten(localization.CONFIGURATION),
    }
    if which == "built":
        configuration = MAPPED[localization.MAPPING].configuration()
        settings["mapping"] = {"num_beams": mapping.NUM_BEAMS, **flatten(configuration)}
    return Cell(f"{task}-{which}", settings)


MAPPING_HEADER = (
    *ACCURACY_HEADER,
    "IoU of free space",
    "length error, m",
    "width error, m",
    "resamplings",
    "fewest ancestors",
    "ms per scan",
)


def _mapping_row(method: Method, cell: Arrays, milliseconds: float) -> list[str]:
    return [
        *accuracy_columns(method, cell),
        f"{cell['free_iou'].mean():.3f}",
        spread_over_seeds(cell["length_error"]),
        spread_over_seeds(cell["width_error"]),
        f"{cell['resamplings'].mean():.0f}",
        f"{cell['least_ancestors'].mean():.1f}",
        f"{milliseconds:.1f}",
    ]


LOCALIZATION_HEADER = (
    "task",
    "map",
    "trials",
    "found at the end",
    "error when tracked, m",
    "updates until found: median, worst",
    "particles, median",
)


def _localization_row(task: str, which: str, cell: Arrays) -> list[str]:
    found, after = cell["found"].ravel(), cell["found_after"].ravel()
    return [
        task,
        which,
        str(found.size),
        f"{int(found.sum())} of {found.size}",
        spread_over_seeds(cell["rmse"].ravel()) if task == "tracking" else "–",
        "–"
        if task == "tracking"
        else ", ".join(_updates(value) for value in (np.median(after), after.max())),
        f"{np.median(cell['num_particles']):.0f}",
    ]


def _updates(count: float) -> str:
    return f"{count:.0f}" if np.isfinite(count) else "never"


if __name__ == "__main__":
    main()
