"""`python -m experiments.range_network [--smoke]`: run all cells, write the tables and the figures."""

from collections.abc import Sequence

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
from experiments._harness.timing import milliseconds_per_scan
from experiments.range_network import runs
from experiments.range_network.cells import run_cell
from experiments.range_network.devices import Quality, calibration, device, learnt
from experiments.range_network.figures import draw_loops
from jaxslam.report.training_folder import PAPERS_MSE, write_training

QUESTION = "Does a network that corrects a cheap lidar let 30 particles close a loop that takes 400 without?"
PARTICLES, SMOKE_PARTICLES = (30, 100, 200, 400), (5,)
DURATION, SMOKE_DURATION = 1050.0, 290.0
"""Seconds: once around the corridor and a tenth of it again; a part of it for a smoke test."""
TIMED_FOR = 200.0
"""Length of the drive on which the filters are timed, seconds."""
REFERENCE, SMOKE_REFERENCE = (1000, 2900.0), (5, 290.0)
"""Particles and length of the drive, seconds, for the ground-truth map."""
WORST = Quality(bias=1.0, noise=1.0)
"""The worst device that the data sheet allows, on which the claim is tested."""
BIASES, NOISES = (0.0, 0.3, 0.6, 1.0), (1 / 3, 2 / 3, 1.0)
PAPER = {30: ("0/10", 53.0, "10/10", 58.0), 100: ("4/10", 47.9, "10/10", 58.3)}
PAPER |= {200: ("6/10", 48.5, "10/10", 61.6), 400: ("10/10", 46.9, "10/10", 67.8)}
"""Table II of Jamaludin et al.: loops closed and inliers, without and with the network."""
WITHOUT_WITH = ("without", "with")


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the experiment."""
    options = parse_options("range_network", QUESTION, seeds=10, arguments=arguments)
    particles = SMOKE_PARTICLES if options.smoke else PARTICLES
    qualities = _swept(options)
    cells = [_training_cell(method, options) for method in ("levenberg-marquardt", "adam")]
    cells += [_reference_cell(which, options) for which in ("known", "built")]
    trials = {(WORST, count, net) for count in particles for net in WITHOUT_WITH}
    trials |= {(quality, particles[0], net) for quality in qualities for net in WITHOUT_WITH}
    # Long cells go first, so that no process has to wait for a long one at the end.
    cells += [_trial_cell(*trial, options) for trial in sorted(trials, key=lambda trial: -trial[1])]
    results = compute(cells, run_cell, options)
    names = [_name(WORST, count, net) for count in particles for net in WITHOUT_WITH]
    by_name = {cell.name: cell for cell in cells}
    timed_for = min(_duration(options), TIMED_FOR)
    times = milliseconds_per_scan(
        names, lambda name: runs.prepared_trial(by_name[name].settings, 0, timed_for)[:2], options
    )
    without, with_network = (_name(WORST, particles[0], net) for net in WITHOUT_WITH)
    draw_loops(options.out / "maps.png", results, (without, with_network))
    _write_training_figures(options)
    text = "\n".join(
        f"{title}:\n\n{table}"
        for title, table in (
            ("Training", _training_table(results)),
            ("Table II, the worst device of the data sheet", _loop_table(particles, results)),
            ("The same in figures", _figures_table(particles, results, times)),
            (
                f"By device, {particles[0]} particles",
                _sweep_table(particles[0], qualities, results),
            ),
        )
    )
    write_results(options, text, _duration(options))


def _duration(options: Options) -> float:
    return SMOKE_DURATION if options.smoke else DURATION


def _swept(options: Options) -> list[Quality]:
    every = [Quality(bias, noise) for noise in NOISES for bias in BIASES]
    return [WORST] if options.smoke else every


def _name(quality: Quality, particles: int, net: str) -> str:
    return f"{net}-{particles}-bias{100 * quality.bias:.0f}-noise{100 * quality.noise:.0f}"


def _trial_cell(quality: Quality, particles: int, net: str, options: Options) -> Cell:
    settings = {
        "task": "trial",
        "bias": quality.bias,
        "noise": quality.noise,
        "particles": particles,
        "network": net == "with",
        "duration": _duration(options),
        "small": options.smoke,
        "seeds": options.seeds,
    }
    return Cell(_name(quality, particles, net), settings)


def _training_cell(method: str, options: Options) -> Cell:
    quality = WORST
    settings = {"task": "training", "method": method, "bias": quality.bias, "noise": quality.noise}
    return Cell(f"training-{method}", {**settings, "seeds": options.seeds})


def _reference_cell(which: str, options: Options) -> Cell:
    particles, duration = SMOKE_REFERENCE if options.smoke else REFERENCE
    duration = duration if which == "built" else _duration(options)
    settings = {"task": "reference", "which": which, "particles": particles, "duration": duration}
    return Cell(f"reference-{which}", {**settings, "small": options.smoke})


def _training_table(results: dict[str, Arrays]) -> str:
    header = ["trained by", "seconds", "steps", "MSE at learnt distances, m²", "RMSE at held-out, mm"]
    header += ["noise there, mm", "raw there, mm"]
    rows = [["the paper", "", "", f"{PAPERS_MSE:.3g}", "", "", ""]]
    for method in ("levenberg-marquardt", "adam"):
        cell = results[f"training-{method}"]
        rows.append(
            [
                method,
                spread_over_seeds(cell["seconds"], digits=1),
                f"{cell['steps'].mean():.0f}",
                f"{cell['mse_learnt'].mean():.3g}",
                spread_over_seeds(cell["held_out"], digits=1, scale=1e3),
                f"{1e3 * cell['held_out_noise'].mean():.1f}",
                f"{1e3 * cell['held_out_raw'].mean():.1f}",
            ]
        )
    return markdown_table(header, rows)


def _loop_table(particles: Sequence[int], results: dict[str, Arrays]) -> str:
    header = [
        "particles",
        "closed without",
        "with",
        "inliers without",
        "with",
        "inliers of known poses without",
    ]
    header += ["with", "paper: closed, inliers without", "with"]
    rows = []
    for count in particles:
        cells = [results[_name(WORST, count, net)] for net in WITHOUT_WITH]
        row = [str(count), *(_closed(cell) for cell in cells)]
        for which in ("built", "known"):
            row += [f"{runs.inliers(cell, results[f'reference-{which}']).mean():.1f}" for cell in cells]
        paper = PAPER.get(count, ("", "", "", ""))
        rows.append([*row, f"{paper[0]} {paper[1]}", f"{paper[2]} {paper[3]}"])
    return markdown_table(header, rows)


def _closed(cell: Arrays) -> str:
    return f"{int(cell['closed'].sum())}/{len(cell['closed'])}"


def _figures_table(particles: Sequence[int], results: dict[str, Arrays], times: dict[str, float]) -> str:
    header = [
        "network",
        "particles",
        "position RMSE, m",
        "error at the loop, m",
        "walls drawn once",
        "map, m",
    ]
    header += ["ms per scan", "CPU seconds", "maps, MB", "peak memory, MB"]
    rows = []
    for net in WITHOUT_WITH:
        for count in particles:
            name = _name(WORST, count, net)
            cell = results[name]
            width, height = cell["extent"].mean(axis=0)
            rows.append(
                [
                    net,
                    str(count),
                    spread_over_seeds(cell["rmse"]),
                    spread_over_seeds(cell["loop_position"]),
                    f"{cell['walls_once'].mean():.3f}",
                    f"{height:.2f} × {width:.2f}",
                    f"{times[name]:.1f}",
                    f"{cell['cpu_seconds'].mean():.0f}",
                    f"{cell['map_megabytes'].mean():.0f}",
                    f"{cell['peak_megabytes'].max():.0f}",
                ]
            )
    return markdown_table(header, rows)


def _sweep_table(particles: int, qualities: Sequence[Quality], results: dict[str, Arrays]) -> str:
    header = ["noise, of the sheet's", "bias, of the sheet's", "closed without", "with"]
    header += ["position RMSE without, m", "with, m"]
    rows = []
    for quality in qualities:
        cells = [results[_name(quality, particles, net)] for net in WITHOUT_WITH]
        row = [f"{quality.noise:.0%}", f"{quality.bias:.0%}", *(_closed(cell) for cell in cells)]
        rows.append([*row, *(spread_over_seeds(cell["rmse"]) for cell in cells)])
    return markdown_table(header, rows)


def _write_training_figures(options: Options) -> None:
    """Draw the figures 8 to 13 for the first device."""
    folder = options.out / "training"
    folder.mkdir(exist_ok=True)
    readings = calibration(device(WORST, 0), 0)
    origin: dict[str, object] = {"device": 0, "bias": WORST.bias, "noise": WORST.noise}
    write_training(folder, learnt(WORST, 0), readings, origin)


if __name__ == "__main__":
    main()
