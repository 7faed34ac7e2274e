"""The errors of a range network: a table, and the figures 8 to 13 of Jamaludin et al."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float64
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxslam.range_network.learning import Split, TrainingResult
from jaxslam.range_network.network import RangeNetwork
from jaxslam.range_network.readings import Readings
from jaxslam.report.folder import write_json
from jaxslam.viz import style

PAPERS_MSE = 9.55e-5
"""Mean squared error of Jamaludin et al. at the training distances, m²."""
_COLORS = {"read": style.REFERENCE, "corrected": style.ESTIMATE}
_ROLES = {"training": "training", "validation": "validation", "held_out": "held out"}
_SHOWN = (1.0, 3.0)
"""Distances of the histograms, meters."""


@dataclass(frozen=True)
class DistanceErrors:
    """Errors of the readings at one distance, meters.

    Attributes:
        distance: true distance.
        role: "training", "validation" or "held out".
        count: number of readings.
        raw_mean, raw_std: mean and standard deviation of reading minus distance.
        corrected_mean, corrected_std: the same for the corrected readings.
    """

    distance: float
    role: str
    count: int
    raw_mean: float
    raw_std: float
    corrected_mean: float
    corrected_std: float


@dataclass(frozen=True)
class RoleErrors:
    """Errors of all readings with one role.

    Attributes:
        role: role as in `DistanceErrors`.
        raw_rmse: RMSE before the correction, meters.
        corrected_rmse: RMSE after the correction, meters.
        noise: RMS deviation of the readings from the mean reading at their distance, meters. A correction
            that depends on the distance only leaves at least this error, unless it compresses the noise.
    """

    role: str
    raw_rmse: float
    corrected_rmse: float
    noise: float


def distance_errors(network: RangeNetwork, readings: Readings, split: Split) -> list[DistanceErrors]:
    """Return the errors at each distance, in ascending order of distance."""
    corrected = corrected_readings(network, readings)
    rows = []
    for distance in readings.distances:
        at = readings.true == distance
        role = next(title for name, title in _ROLES.items() if np.any(getattr(split, name)[at]))
        raw, after = readings.measured[at] - distance, corrected[at] - distance
        errors = (raw.mean(), raw.std(), after.mean(), after.std())
        rows.append(DistanceErrors(float(distance), role, int(at.sum()), *map(float, errors)))
    return rows


def role_errors(rows: list[DistanceErrors]) -> list[RoleErrors]:
    """Combine the errors at single distances into errors of all readings of each role."""
    found = []
    for role in dict.fromkeys(row.role for row in rows):
        chosen = [row for row in rows if row.role == role]
        squares = (
            [row.raw_mean**2 + row.raw_std**2 for row in chosen],
            [row.corrected_mean**2 + row.corrected_std**2 for row in chosen],
            [row.raw_std**2 for row in chosen],
        )
        count = np.array([row.count for row in chosen], float)
        found.append(RoleErrors(role, *np.sqrt(np.average(squares, axis=1, weights=count)).tolist()))
    return found


def corrected_readings(network: RangeNetwork, readings: Readings) -> Float64[np.ndarray, "M"]:
    """Return the readings corrected by the network, meters."""
    return np.asarray(network(jnp.asarray(readings.measured, jnp.float32)), np.float64)


def error_table(rows: list[DistanceErrors]) -> str:
    """Format the errors by distance and by role as text, millimeters."""
    lines = [
        f"{'distance':>10} {'readings':>9} {'error':>16} {'corrected':>16}  ",
        f"{'m':>10} {'':>9} {'mean ± std, mm':>16} {'mean ± std, mm':>16}  role",
    ]
    lines += [
        f"{row.distance:>10.3f} {row.count:>9} {1e3 * row.raw_mean:>+8.1f} ± {1e3 * row.raw_std:<5.1f} "
        f"{1e3 * row.corrected_mean:>+8.1f} ± {1e3 * row.corrected_std:<5.1f}  {row.role}"
        for row in rows
    ]
    lines += ["", f"{'RMSE, mm':>20} {'raw':>8} {'corrected':>10} {'noise':>8}"]
    lines += [
        f"{row.role:>20} {1e3 * row.raw_rmse:>8.2f} {1e3 * row.corrected_rmse:>10.2f} {1e3 * row.noise:>8.2f}"
        for row in role_errors(rows)
    ]
    return "\n".join(lines)


def write_training(
    folder: Path, training: TrainingResult, readings: Readings, origin: dict[str, object]
) -> list[DistanceErrors]:
    """Write the figures and `training.json` into an existing folder, and return the errors by distance.

    Raises:
        OSError: a file cannot be written.
    """
    rows = distance_errors(training.network, readings, training.split)
    _save_figures(folder, training, readings, rows)
    write_json(
        folder / "training.json",
        {
            **origin,
            "readings": len(readings.true),
            "lost": readings.num_lost,
            "attempts": [asdict(attempt) for attempt in training.attempts],
            "distances": [asdict(row) for row in rows],
            "roles": [asdict(row) for row in role_errors(rows)],
        },
    )
    return rows


def _save_figures(
    folder: Path, training: TrainingResult, readings: Readings, rows: list[DistanceErrors]
) -> None:
    """Draw readings, errors and standard deviations over distance, histograms, and the training."""
    distance = np.array([row.distance for row in rows])
    held_out = np.array([row.role == "held out" for row in rows])
    means = {
        "read": np.array([row.raw_mean for row in rows]),
        "corrected": np.array([row.corrected_mean for row in rows]),
    }
    deviations = {"read": [row.raw_std for row in rows], "corrected": [row.corrected_std for row in rows]}

    with _picture(folder / "readings.png", "distance (m)", "mean reading (m)") as [ax]:
        ax.plot(distance, distance, color=style.NEUTRAL, linewidth=0.8, label="true")
        for label, color in _COLORS.items():
            ax.plot(distance, distance + means[label], ".", color=color, label=label)

    with _picture(folder / "errors.png", "distance (m)", "mean error (mm)") as [ax]:
        ax.axhline(0.0, color=style.NEUTRAL, linewidth=0.8)
        for label, color in _COLORS.items():
            mean = 1e3 * means[label]
            ax.plot(distance, mean, "-", color=color, linewidth=1.0)
            ax.plot(distance[~held_out], mean[~held_out], "o", color=color, markersize=4, label=label)
            ax.plot(distance[held_out], mean[held_out], "D", color=color, mfc="w", markersize=6)
        if held_out.any():
            ax.plot([], [], "D", color=style.NEUTRAL, mfc="w", label="held out")

    corrected = corrected_readings(training.network, readings)
    with _picture(folder / "histograms.png", "reading (m)", "readings", len(_SHOWN)) as axes:
        for ax, wanted in zip(axes, _SHOWN, strict=True):
            nearest = distance[np.argmin(np.abs(distance - wanted))]
            at = readings.true == nearest
            both = np.concatenate([readings.measured[at], corrected[at]])
            bins = np.linspace(both.min(), both.max() + 1e-6, 60).tolist()
            for values, label in ((readings.measured, "read"), (corrected, "corrected")):
                ax.hist(values[at], bins=bins, color=_COLORS[label], alpha=0.6, label=label)
            ax.axvline(nearest, color=style.NEUTRAL, linewidth=1.0)
            ax.set_title(f"{nearest:g} m", fontsize="medium")

    with _picture(folder / "deviations.png", "distance (m)", "standard deviation (mm)") as [ax]:
        for label, color in _COLORS.items():
            ax.plot(
                distance, 1e3 * np.array(deviations[label]), ".-", color=color, linewidth=1.0, label=label
            )
        ax.set_ylim(bottom=0.0)

    with _picture(folder / "training.png", "step", "RMSE (mm)") as [ax]:
        history = np.sqrt(np.asarray(training.fit.history, np.float64))
        history = history[np.isfinite(history[:, 0])]
        for values, color, label in zip(history.T, _COLORS.values(), ("training", "validation"), strict=True):
            ax.semilogy(np.arange(1, len(values) + 1), 1e3 * values, color=color, label=label)
        ax.axvline(int(training.fit.steps), color=style.NEUTRAL, linewidth=0.8, linestyle="--", label="kept")


@contextmanager
def _picture(path: Path, x_label: str, y_label: str, columns: int = 1) -> Iterator[list[Axes]]:
    """Yield axes to draw on, then label and save them."""
    figure = Figure(figsize=(5.0 * columns + 1.0, 4.0), layout="constrained")
    axes = list(figure.subplots(1, columns, squeeze=False)[0])
    yield axes
    for ax in axes:
        style.curve_axes(ax, x_label, y_label)
        style.add_legend(ax)
    figure.savefig(path, dpi=120)
