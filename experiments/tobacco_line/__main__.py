"""`python -m experiments.tobacco_line [--smoke]`: run all cells, write the table and the figures."""

from collections.abc import Sequence

from experiments._harness.accuracy import ACCURACY_HEADER, accuracy_columns
from experiments._harness.harness import Arrays, Cell, compute, markdown_table, parse_options, write_results
from experiments._harness.method import Method
from experiments._harness.timing import milliseconds_per_scan
from experiments.tobacco_line.figures import DRAWN, draw_clouds, draw_errors, draw_halls
from experiments.tobacco_line.methods import ABLATION, COMPARED, EQUAL, evaluations
from experiments.tobacco_line.runs import METHODS, prepared, run_cell
from jaxslam.config.dotted import flatten

QUESTION = "Do 15 particles of the improved filter do what 30 of the traditional one do?"
WORLDS = ("hall_small", "hall_large")
DURATION, SMOKE_DURATION = 200.0, 6.0
TIMED_FOR = 40.0
"""Length of the drive on which the methods are timed, seconds."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the experiment."""
    options = parse_options("tobacco_line", QUESTION, seeds=10, arguments=arguments)
    worlds = WORLDS[:1] if options.smoke else WORLDS
    names = list(DRAWN) if options.smoke else list(METHODS)
    duration = SMOKE_DURATION if options.smoke else DURATION
    cells = [_cell(world, name, duration, options.seeds) for world in worlds for name in names]
    results = compute(cells, run_cell, options)
    timed_for = min(duration, TIMED_FOR)
    times = milliseconds_per_scan(names, lambda name: prepared(WORLDS[0], 0, timed_for, name)[:2], options)
    for world in worlds:
        draw_halls(options.out / f"{world}-maps.png", world, results)
        draw_errors(options.out / f"{world}-errors.png", world, results)
        draw_clouds(options.out / f"{world}-clouds.png", world, results)
    text = "\n".join(
        f"### {world}\n\n" + "\n".join(_tables(world, names, results, times)) for world in worlds
    )
    write_results(options, text, duration)


def _cell(world: str, name: str, duration: float, seeds: int) -> Cell:
    settings = {
        "world": world,
        "method": name,
        "duration": duration,
        "seeds": seeds,
        "configuration": flatten(METHODS[name].configuration()),
    }
    return Cell(f"{world}-{name}", settings)


def _tables(world: str, names: list[str], results: dict[str, Arrays], times: dict[str, float]) -> list[str]:
    """Return the comparison, the ablation, and the comparison at equal evaluations."""
    groups = {
        "Methods": COMPARED,
        "One piece changed": {"improved-15": COMPARED["improved-15"], **ABLATION},
        "At an equal number of evaluations": EQUAL,
    }
    tables = []
    for title, group in groups.items():
        present = {name: method for name, method in group.items() if name in names}
        if len(present) > 1 or title == "Methods":
            rows = [_row(method, results[f"{world}-{name}"], times[name]) for name, method in present.items()]
            tables.append(f"{title}:\n\n" + markdown_table(HEADER, rows))
    return tables


HEADER = (
    *ACCURACY_HEADER,
    "particles around the truth, m",
    "spread, m",
    "evaluations per scan",
    "ms per scan",
)


def _row(method: Method, cell: Arrays, milliseconds: float) -> list[str]:
    return [
        *accuracy_columns(method, cell),
        f"{cell['around_truth'].mean():.3f}",
        f"{cell['spread'].mean():.3f}",
        str(evaluations(method)),
        f"{milliseconds:.1f}",
    ]


if __name__ == "__main__":
    main()
