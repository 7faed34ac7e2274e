"""Report of a study: tables, importances, plots, and the best configurations as files."""

import dataclasses
import json
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import optuna
from jaxtyping import Float64
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from optuna.trial import FrozenTrial, TrialState

from jaxslam.config import toml
from jaxslam.config.dotted import Scalar
from jaxslam.study.objectives import OBJECTIVES
from jaxslam.study.plan import starting_with
from jaxslam.study.space import with_settings
from jaxslam.study.storage import Store, failure
from jaxslam.viz import style

SHOWN = 10
"""Trials in the printed table."""
FEWEST = 5
"""With fewer trials, importances are not computed."""
_MOST_TICKS = 5
_ABSENT = -0.1
"""Height in the parallel coordinates of a trial that has no such parameter."""
_WIDE = 20.0
"""The scale is logarithmic if the largest value exceeds the median by this factor."""
_APART = 0.045
"""Smallest distance of two trial numbers on the Pareto front, as a share of the axes."""


@dataclass(frozen=True)
class Summary:
    """A study at a glance.

    Attributes:
        objectives: names of the objectives.
        complete: trials with values, best first (by the first objective).
        failed: number and reason of every failed trial.
        lost: number of trials that are in flight, or were left behind by killed processes.
        front: the Pareto front of `complete`; for one objective, the best trial.
        importances: share of every parameter in an objective's variance, by objective; empty if there are
            too few trials.
    """

    objectives: tuple[str, ...]
    complete: tuple[FrozenTrial, ...]
    failed: tuple[tuple[int, str], ...]
    lost: int
    front: tuple[FrozenTrial, ...]
    importances: dict[str, dict[str, float]]

    @property
    def best(self) -> FrozenTrial:
        """Return the best trial by the first objective.

        Raises:
            ValueError: no trial has values.
        """
        if not self.complete:
            raise ValueError("no trial of this study has values yet")
        return self.complete[0]

    @property
    def labels(self) -> list[str]:
        """Return the labels of the objectives."""
        return [OBJECTIVES[name].label for name in self.objectives]

    @property
    def settings(self) -> list[str]:
        """Return the names of all settings of the trials, those of the best trial first."""
        return list(dict.fromkeys(name for trial in self.complete for name in trial.params))

    @property
    def important(self) -> list[str]:
        """Return the names of all settings with an importance, in the order of the first objective."""
        return list(dict.fromkeys(name for shares in self.importances.values() for name in shares))


def summarize(store: Store, objectives: Sequence[str]) -> Summary:
    """Collect the trials and importances of a study."""
    trials = store.trials()
    complete = [trial for trial in trials if trial.state == TrialState.COMPLETE]
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
    """Return the trials as a Markdown table, best first; a star marks the Pareto front."""
    names = summary.settings
    front = {trial.number for trial in summary.front}
    rows = []
    for trial in summary.complete[:count]:
        mark = " *" if trial.number in front else ""
        tried = [trial.params.get(name, "") for name in names]
        rows.append([f"{trial.number}{mark}", *map(cell, trial.values), *map(cell, tried)])
    return markdown_table(["trial", *summary.labels, *names], rows)


def importance_table(summary: Summary) -> str:
    """Return the share of each parameter in an objective's variance as a Markdown table."""
    names = summary.important
    if not names:
        return "Too few trials to estimate which parameters matter."
    rows = []
    for objective, label in zip(summary.objectives, summary.labels, strict=True):
        shares = summary.importances[objective]
        rows.append([label, *(f"{shares[name]:.2f}" if name in shares else "" for name in names)])
    return markdown_table(["importance for", *names], rows)


def markdown_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table."""
    first, *others = ("| " + " | ".join(row) + " |" for row in (header, *rows))
    return "\n".join([first, "|" + "---|" * len(header), *others])


def write_report(folder: Path, store: Store, plan: dict[str, Any]) -> Summary:
    """Write `report.md`, `trials.json`, `best.toml` (and one file per trial of the front) and plots.

    Args:
        folder: an existing folder.
        store: the study.
        plan: the description of the plan, as in the storage.

    Raises:
        ValueError: no trial has values.
        OSError: a file cannot be written.
    """
    summary = summarize(store, plan["objectives"])
    best = summary.best
    # Files of an earlier report that this report may not write again.
    for path in (*folder.glob("front-*.toml"), folder / "importance.png"):
        path.unlink(missing_ok=True)
    several = len(summary.objectives) > 1
    text = [f"# {store.study.study_name}", counts(summary), trial_table(summary), importance_table(summary)]
    if several:
        text.insert(3, "Stars mark the Pareto front: no other trial is better in all objectives.")
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
    draw(folder, summary)
    return summary


def counts(summary: Summary) -> str:
    """Return one line with the number of trials and the reasons for failures."""
    complete, failed = len(summary.complete), len(summary.failed)
    trials = "trial" if complete == 1 else "trials"
    text = f"{complete} {trials} with values, {failed} failed, {summary.lost} lost or in flight."
    reasons: dict[str, list[int]] = {}
    for number, reason in summary.failed:
        reasons.setdefault(reason, []).append(number)
    return " ".join([text, *(f"Trial {', '.join(map(str, n))}: {reason}." for reason, n in reasons.items())])


def write_configuration(path: Path, plan: dict[str, Any], settings: dict[str, Scalar]) -> None:
    """Write a trial's complete configuration as TOML for `jaxslam run --config`.

    If no setting of the lidar is tuned, the file has no lidar, and `run` detects it from the log. Otherwise
    it has the lidar of the first source.
    """
    start = starting_with(plan["sources"][0]["lidar"])
    configuration = with_settings(with_settings(start, plan["base"]), settings)
    tuned_lidar = any(name.startswith("lidar.") for name in {**plan["base"], **settings})
    toml.save(path, configuration if tuned_lidar else dataclasses.replace(configuration, lidar=None))


def draw(folder: Path, summary: Summary) -> None:
    """Draw history, parallel coordinates and importances; for two objectives also the Pareto front."""
    several = len(summary.objectives)
    _save(folder / "history.png", summary, _draw_history, (7, 2.9 * several + 0.4))
    width = 1.6 * (len(summary.settings) + several) + 2
    _save(folder / "parallel.png", summary, draw_parallel, (width, 4.5))
    bars = max(map(len, summary.importances.values()))
    if bars:
        _save(folder / "importance.png", summary, _draw_importances, (3.5 + 3.0 * several, 0.4 * bars + 1.3))
    if several == 2:
        _save(folder / "pareto.png", summary, _draw_front, (6, 4.5))


def _save(
    path: Path, summary: Summary, function: Callable[[Figure, Summary], None], size: tuple[float, float]
) -> None:
    figure = Figure(figsize=size, layout="constrained")
    function(figure, summary)
    figure.savefig(path, dpi=110)


def _draw_history(figure: Figure, summary: Summary) -> None:
    axes = figure.subplots(len(summary.objectives), 1, squeeze=False, sharex=True)[:, 0]
    by_number = sorted(summary.complete, key=lambda trial: trial.number)
    numbers = [trial.number for trial in by_number]
    failed = [number for number, _ in summary.failed]
    for ax, label, reached in zip(axes, summary.labels, _values(by_number), strict=True):
        best = np.minimum.accumulate(reached)
        ax.plot(numbers, reached, "o", color=style.NEUTRAL, markersize=3.5, label="trial")
        ax.step(numbers, best, where="post", color=style.ESTIMATE, label="best so far")
        if failed:
            # Failed trials have no value: draw them on the lower edge, whatever the scale is.
            edge = {"transform": ax.get_xaxis_transform(), "clip_on": False}
            ax.plot(failed, np.zeros(len(failed)), "x", color=style.REFERENCE, label="failed", **edge)
        if _is_wide(reached):
            ax.set_yscale("log")
        ax.xaxis.set_major_locator(MaxNLocator(integer=True, steps=[1, 2, 5, 10], min_n_ticks=1))
        style.curve_axes(ax, "trial" if ax is axes[-1] else "", label)
    style.add_legend(axes[0])


def draw_parallel(figure: Figure, summary: Summary) -> None:
    """Draw every trial as a line over its settings and objectives, each with its own scale."""
    ax = figure.subplots()
    columns = [_setting_column(summary, name) for name in summary.settings]
    columns += [_column(values.tolist()) for values in _values(summary.complete)]
    worst = len(summary.complete) - 1
    # Draw the best trials last, on top of the others.
    for rank in range(worst, -1, -1):
        shade = 0.85 * rank / max(worst, 1)
        line = [heights[rank] for heights, _ in columns]
        color = style.REFERENCE if rank == 0 else str(shade)
        ax.plot(range(len(columns)), line, color=color, linewidth=2.0 if rank == 0 else 0.9)
    for place, (_, ticks) in enumerate(columns):
        ax.axvline(place, color="0.6", linewidth=0.6)
        for height, text in ticks.items():
            ax.annotate(
                text,
                (place, height),
                textcoords="offset points",
                xytext=(4, 0),
                fontsize="x-small",
                va="center",
                bbox={"boxstyle": "square,pad=0.1", "facecolor": "white", "edgecolor": "none", "alpha": 0.8},
            )
    labels = [*(name.replace(".", ".\n") for name in summary.settings), *summary.labels]
    ax.set_xticks(range(len(columns)), labels, fontsize="small")
    ax.set_yticks([])
    ax.tick_params(length=0)
    ax.set_xlim(-0.1, len(columns) - 0.5)
    ax.spines[:].set_visible(False)
    by = f" by {summary.labels[0].partition(',')[0]}" if len(summary.objectives) > 1 else ""
    ax.set_title(f"all trials, dark is better{by}; the best one in color", fontsize="small")


def _setting_column(summary: Summary, name: str) -> tuple[list[float], dict[float, str]]:
    having = [trial for trial in summary.complete if name in trial.params]
    log = getattr(having[0].distributions[name], "log", False)
    there, ticks = _column([trial.params[name] for trial in having], log)
    heights = dict(zip((trial.number for trial in having), there, strict=True))
    if len(having) < len(summary.complete):
        # Trials without this setting are drawn below its axis.
        ticks[_ABSENT] = "none"
    return [heights.get(trial.number, _ABSENT) for trial in summary.complete], ticks


def _column(values: Sequence[Scalar], log: bool | None = None) -> tuple[list[float], dict[float, str]]:
    """Return the heights 0 to 1 of values on an axis (choices evenly spaced), and tick labels by height."""
    if any(isinstance(value, str | bool) for value in values):
        known = sorted(set(map(str, values)))
        heights = [known.index(str(value)) / max(len(known) - 1, 1) for value in values]
    else:
        numbers = np.array(values, float)
        if log or (log is None and _is_wide(numbers)):
            numbers = np.log(numbers)
        span = numbers.max() - numbers.min()
        heights = ((numbers - numbers.min()) / span if span > 0 else 0.5 + 0 * numbers).tolist()
    ticks = dict(zip(heights, map(cell, values), strict=True))
    shown = ticks if len(ticks) <= _MOST_TICKS else {end: ticks[end] for end in (min(ticks), max(ticks))}
    return heights, shown


def _is_wide(values: Float64[np.ndarray, "T"]) -> bool:
    """Return whether a few values are so large that the others would look equal."""
    return bool(values.min() > 0 and values.max() > _WIDE * np.median(values))


def _draw_importances(figure: Figure, summary: Summary) -> None:
    axes = figure.subplots(1, len(summary.objectives), squeeze=False, sharey=True)[0]
    # The first bar is at the bottom.
    names = summary.important[::-1]
    for ax, objective, label in zip(axes, summary.objectives, summary.labels, strict=True):
        shares = summary.importances[objective]
        ax.barh(names, [shares.get(name, 0.0) for name in names], color=style.ESTIMATE, height=0.6)
        ax.set_xlim(0.0, 1.0)
        style.curve_axes(ax, label, "")
    figure.suptitle("share of the variance", fontsize="medium")


def _draw_front(figure: Figure, summary: Summary) -> None:
    ax = figure.subplots()
    every, front = _values(summary.complete), _values(summary.front)
    ax.plot(*every, "o", color=style.NEUTRAL, markersize=4, label="trial")
    # Between two trials of the front, only the worse value of both is known to be reachable.
    ax.step(*front, "o-", where="post", color=style.REFERENCE, linewidth=1.2, label="Pareto front")
    if _is_wide(front[0]) or _is_wide(every[0]):
        ax.set_xscale("log")
    if _is_wide(front[1]) or _is_wide(every[1]):
        ax.set_yscale("log")
    style.curve_axes(ax, *summary.labels)
    style.add_legend(ax)
    ax.autoscale_view()
    labeled: list[Any] = []
    for trial in summary.front:
        at = ax.transAxes.inverted().transform(ax.transData.transform(trial.values))
        # Numbers of trials that lie close together would overlap.
        if all(np.abs(at - other).max() > _APART for other in labeled):
            labeled.append(at)
            ax.annotate(
                str(trial.number),
                trial.values,
                textcoords="offset points",
                xytext=(-4, -5),
                ha="right",
                va="top",
                fontsize="small",
            )


def _values(trials: Sequence[FrozenTrial]) -> Float64[np.ndarray, "O T"]:
    return np.array([trial.values for trial in trials]).T


def _importances(study: optuna.Study, index: int) -> dict[str, float]:
    """Return fANOVA importances; empty if they cannot be computed."""
    if len(study.get_trials(deepcopy=False, states=[TrialState.COMPLETE])) < FEWEST:
        return {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        try:
            return optuna.importance.get_param_importances(
                study,
                evaluator=optuna.importance.FanovaImportanceEvaluator(seed=0),
                target=lambda trial: trial.values[index],
            )
        except (ValueError, RuntimeError):
            # All trials have the same value, or no parameter in common.
            return {}


def cell(value: Scalar) -> str:
    """Format a setting for tables and messages."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)
