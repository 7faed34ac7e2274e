"""What a study found: tables, importances, pictures, and the best configurations as files."""

import json
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import optuna
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from optuna.trial import FrozenTrial

from jaxslam import toml
from jaxslam.configuration import Configuration
from jaxslam.settings import Scalar
from jaxslam.study.objectives import OBJECTIVES
from jaxslam.study.plan import with_settings
from jaxslam.study.storage import Store, failure
from jaxslam.viz import style

SHOWN = 10
"""Trials in the printed table."""


@dataclass(frozen=True)
class Summary:
    """A study at a glance.

    Attributes:
        objectives: their names.
        complete: trials with values, best first (by the first objective).
        failed: trials without, and why.
        lost: how many trials were left behind by processes that were killed.
        front: those of `complete` than which none is better in all objectives; of one objective, the best.
        importances: for every objective the share of its variance by parameter; empty where too few trials
            are there to tell.
    """

    objectives: tuple[str, ...]
    complete: tuple[FrozenTrial, ...]
    failed: tuple[tuple[int, str], ...]
    lost: int
    front: tuple[FrozenTrial, ...]
    importances: dict[str, dict[str, float]]

    @property
    def best(self) -> FrozenTrial:
        """The best by the first objective.

        Raises:
            ValueError: no trial has values.
        """
        if not self.complete:
            raise ValueError("no trial of this study has values yet")
        return self.complete[0]


def summarise(store: Store, objectives: Sequence[str]) -> Summary:
    """Looks through a study."""
    trials = store.trials()
    complete = [trial for trial in trials if trial.state == optuna.trial.TrialState.COMPLETE]
    failed = [(trial.number, reason) for trial in trials if (reason := failure(trial)) is not None]
    return Summary(
        objectives=tuple(objectives),
        complete=tuple(sorted(complete, key=lambda trial: trial.values)),
        failed=tuple(failed),
        lost=len(trials) - len(complete) - len(failed),
        front=tuple(sorted(store.study.best_trials, key=lambda trial: trial.values)) if complete else (),
        importances={name: _importances(store.study, index) for index, name in enumerate(objectives)},
    )


def trial_table(summary: Summary, count: int | None = None) -> str:
    """The trials as a Markdown table, best first; those of the front are marked."""
    names = list(dict.fromkeys(name for trial in summary.complete for name in trial.params))
    front = {trial.number for trial in summary.front}
    labels = [OBJECTIVES[name].label for name in summary.objectives]
    lines = [
        "| trial | " + " | ".join([*labels, *names]) + " |",
        "|" + "---|" * (1 + len(labels) + len(names)),
    ]
    for trial in summary.complete[:count]:
        mark = " *" if trial.number in front else ""
        cells = [f"{value:.4g}" for value in trial.values]
        cells += [_cell(trial.params[name]) if name in trial.params else "" for name in names]
        lines.append(f"| {trial.number}{mark} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def importance_table(summary: Summary) -> str:
    """How much of an objective's variance each parameter makes, as a Markdown table."""
    names = list(dict.fromkeys(name for shares in summary.importances.values() for name in shares))
    if not names:
        return "Too few trials to tell which parameters matter."
    labels = [OBJECTIVES[name].label for name in summary.objectives]
    lines = ["| importance for | " + " | ".join(names) + " |", "|" + "---|" * (1 + len(names))]
    for objective, label in zip(summary.objectives, labels, strict=True):
        shares = summary.importances[objective]
        cells = [f"{shares[name]:.2f}" if name in shares else "" for name in names]
        lines.append(f"| {label} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def write_report(folder: Path, store: Store, plan: dict[str, Any]) -> Summary:
    """Writes `report.md`, `trials.json`, `best.toml` (and one file for each of the front) and pictures.

    Args:
        folder: exists.
        store: the study.
        plan: what describes it, as in the storage.

    Raises:
        ValueError: no trial has values.
        OSError: a file cannot be written.
    """
    summary = summarise(store, plan["objectives"])
    best = summary.best
    several = len(summary.objectives) > 1
    text = [f"# {store.study.study_name}", counts(summary), trial_table(summary), importance_table(summary)]
    if several:
        text.insert(3, "Trials with a star are better than any other in some objective: the Pareto front.")
    (folder / "report.md").write_text("\n\n".join(text) + "\n", encoding="utf-8")
    rows = [
        {"number": trial.number, "values": trial.values, "settings": trial.params, "failure": failure(trial)}
        for trial in store.trials()
    ]
    (folder / "trials.json").write_text(json.dumps(rows, indent=1) + "\n")
    write_configuration(folder / "best.toml", plan, best.params)
    if several:
        for trial in summary.front:
            write_configuration(folder / f"front-{trial.number}.toml", plan, trial.params)
    draw(folder, store.study, summary)
    return summary


def counts(summary: Summary) -> str:
    """How many trials there are, in a line, and why some of them failed."""
    failed, lost = len(summary.failed), summary.lost
    text = f"{len(summary.complete)} trials with values, {failed} failed, {lost} lost or in flight."
    reasons: dict[str, list[int]] = {}
    for number, reason in summary.failed:
        reasons.setdefault(reason, []).append(number)
    return " ".join([text, *(f"Trial {', '.join(map(str, n))}: {reason}." for reason, n in reasons.items())])


def write_configuration(path: Path, plan: dict[str, Any], settings: dict[str, Scalar]) -> None:
    """A trial's whole filter as TOML for `jaxslam run --config`; a lidar that is not tuned is left out."""
    configuration = with_settings(with_settings(Configuration(), plan["base"]), settings)
    tuned_lidar = any(name.startswith("lidar.") for name in {**plan["base"], **settings})
    path.write_text(toml.dumps(configuration, without=None if tuned_lidar else "lidar"), encoding="utf-8")


def draw(folder: Path, study: optuna.Study, summary: Summary) -> None:
    """History, parallel coordinates and importances; of two objectives the Pareto front."""
    _save(folder / "history.png", summary, _draw_history, (7, 3.2 * len(summary.objectives)))
    names = [name for name in summary.best.params if all(name in trial.params for trial in summary.complete)]
    width = 1.6 * (len(names) + 1) + 2
    _save(folder / "parallel.png", summary, lambda figure, s: draw_parallel(figure, s, names), (width, 4.5))
    if any(summary.importances.values()):
        _save(folder / "importance.png", summary, _draw_importances, (7, 3.2))
    if len(summary.objectives) == 2:
        _save(folder / "pareto.png", summary, _draw_front, (6, 4.5))


def _save(
    path: Path, summary: Summary, function: Callable[[Figure, Summary], None], size: tuple[float, float]
) -> None:
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    function(figure, summary)
    figure.savefig(path, dpi=110)


def _draw_history(figure: Figure, summary: Summary) -> None:
    axes = figure.subplots(len(summary.objectives), 1, squeeze=False)[:, 0]
    by_number = sorted(summary.complete, key=lambda trial: trial.number)
    for index, (ax, name) in enumerate(zip(axes, summary.objectives, strict=True)):
        numbers = [trial.number for trial in by_number]
        reached = [trial.values[index] for trial in by_number]
        best = [min(reached[: end + 1]) for end in range(len(reached))]
        ax.plot(numbers, reached, "o", color=style.NEUTRAL, markersize=3.5, label="trial")
        ax.step(numbers, best, where="post", color=style.ESTIMATE, label="best so far")
        style.curve_axes(ax, "trial", OBJECTIVES[name].label)
        style.add_legend(ax)


def draw_parallel(figure: Figure, summary: Summary, names: Sequence[str]) -> None:
    """Every trial as a line over its settings and its first objective, each on a scale of its own."""
    ax = figure.subplots()
    label = OBJECTIVES[summary.objectives[0]].label
    columns = [[trial.params[name] for trial in summary.complete] for name in names]
    columns.append([trial.values[0] for trial in summary.complete])
    places = [_places(column) for column in columns]
    worst = len(summary.complete) - 1
    # The best are drawn last, on top of the others.
    for rank in range(worst, -1, -1):
        shade = 0.85 * rank / max(worst, 1)
        line = [column[rank] for column in places]
        color = style.REFERENCE if rank == 0 else str(shade)
        ax.plot(range(len(columns)), line, color=color, linewidth=2.0 if rank == 0 else 0.9)
    for place, column in enumerate(columns):
        ticks = dict(zip(_places(column), column, strict=True))
        shown = sorted(ticks) if len(ticks) <= 5 else [min(ticks), max(ticks)]
        for height in shown:
            ax.annotate(
                _cell(ticks[height]),
                (place, height),
                textcoords="offset points",
                xytext=(4, 0),
                fontsize="x-small",
                va="center",
                bbox={"boxstyle": "square,pad=0.1", "facecolor": "white", "edgecolor": "none", "alpha": 0.8},
            )
        ax.axvline(place, color="0.6", linewidth=0.6)
    ax.set_xticks(
        range(len(columns)), [*(name.replace(".", ".\n") for name in names), label], fontsize="small"
    )
    ax.set_yticks([])
    ax.set_xlim(-0.1, len(columns) - 0.6)
    ax.spines[:].set_visible(False)
    ax.set_title("all trials, dark is better; the best one in colour", fontsize="small")


def _places(column: Sequence[Scalar]) -> list[float]:
    """Heights 0 to 1 of values on an axis; of choices, evenly."""
    if any(isinstance(value, str | bool) for value in column):
        known = sorted(set(map(str, column)))
        return [known.index(str(value)) / max(len(known) - 1, 1) for value in column]
    numbers = [float(value) for value in column]
    low, high = min(numbers), max(numbers)
    return [(value - low) / (high - low) if high > low else 0.5 for value in numbers]


def _draw_importances(figure: Figure, summary: Summary) -> None:
    axes = figure.subplots(1, len(summary.objectives), squeeze=False)[0]
    for ax, name in zip(axes, summary.objectives, strict=True):
        shares = dict(reversed(summary.importances[name].items()))
        ax.barh(list(shares), list(shares.values()), color=style.ESTIMATE)
        style.curve_axes(ax, f"share of the variance of {OBJECTIVES[name].label}", "")


def _draw_front(figure: Figure, summary: Summary) -> None:
    ax = figure.subplots()
    ax.plot(*_columns(summary.complete), "o", color=style.NEUTRAL, markersize=4, label="trial")
    ax.plot(*_columns(summary.front), "o-", color=style.REFERENCE, label="Pareto front")
    for trial in summary.front:
        ax.annotate(
            str(trial.number), trial.values, textcoords="offset points", xytext=(5, 4), fontsize="small"
        )
    style.curve_axes(ax, *(OBJECTIVES[name].label for name in summary.objectives))
    style.add_legend(ax)


def _columns(trials: Sequence[FrozenTrial]) -> tuple[list[float], list[float]]:
    return [trial.values[0] for trial in trials], [trial.values[1] for trial in trials]


def _importances(study: optuna.Study, index: int) -> dict[str, float]:
    """By fANOVA; empty where it cannot be told."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        try:
            return optuna.importance.get_param_importances(
                study,
                evaluator=optuna.importance.FanovaImportanceEvaluator(seed=0),
                target=lambda trial: trial.values[index],
            )
        except (ValueError, RuntimeError):
            # Fewer than two trials, all of one value, or no parameter that all of them have.
            return {}


def _cell(value: Scalar) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
