"""The figures 4 to 7 of Liang et al., drawn from the results."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from experiments._harness.harness import Arrays
from experiments._harness.maps import draw_maps
from experiments.tobacco_line.methods import COMPARED
from jaxslam.viz import plot_errors, plot_particles

TRADITIONAL, IMPROVED = "traditional-30", "improved-15"
DRAWN = {"traditional-30": "tab:red", "gmapping-30": "tab:orange", "improved-15": "tab:blue"}
"""The methods in the figures, with their colors."""
_CLOUD_SIDE = 0.6
"""Smallest side of the picture of a particle cloud, meters."""


def draw_halls(path: Path, world: str, results: dict[str, Arrays]) -> None:
    """Draw the map of a hall by the traditional and by the improved filter (figures 4 and 5)."""
    shown = [(COMPARED[name], results[f"{world}-{name}"]) for name in (TRADITIONAL, IMPROVED)]
    draw_maps(path, shown, (1, 2), (11, 5.4))


def draw_errors(path: Path, world: str, results: dict[str, Arrays]) -> None:
    """Draw the pose error over time: mean over seeds, and the range from the best to the worst (figure 6)."""
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    position, heading = figure.subplots(1, 2)
    for key, color in DRAWN.items():
        cell, method = results[f"{world}-{key}"], COMPARED[key]
        label = f"{method.title}, {method.particles}"
        times, near, turned = cell["one_times"], cell["position"], cell["heading"]
        plot_errors(times, near, _edges(near), position, label=label, color=color)
        plot_errors(times, turned, _edges(turned), heading, quantity="heading", color=color)
    # Errors range from millimeters to half a meter: on a linear axis the best curve would lie at zero.
    position.set(yscale="log", ylim=(1e-3, None))
    heading.set(yscale="log", ylim=(1e-3, None))
    _save(figure, path)


def _edges(over_seeds: np.ndarray) -> np.ndarray:
    return np.stack([over_seeds.min(axis=0), over_seeds.max(axis=0)])


def draw_clouds(path: Path, world: str, results: dict[str, Arrays]) -> None:
    """Draw the particles of seed 0 after filtering, relative to the true position (figure 7)."""
    names = list(DRAWN)
    count = len(results[f"{world}-{names[0]}"]["one_clouds"])
    figure = Figure(figsize=(3.4 * count, 3.4 * len(names)), layout="constrained")
    for row, name in zip(figure.subplots(len(names), count, squeeze=False), names, strict=True):
        cell, method = results[f"{world}-{name}"], COMPARED[name]
        for ax, cloud, truth in zip(row, cell["one_clouds"], cell["one_cloud_truth"], strict=True):
            centred = cloud - np.array([truth[0], truth[1], 0.0])
            plot_particles(centred, ax=ax)
            ax.plot(0.0, 0.0, "+", color="black", markersize=12, label="truth")
            half = max(_CLOUD_SIDE / 2, 1.1 * float(np.abs(centred[:, :2]).max()))
            ax.set(xlim=(-half, half), ylim=(-half, half), aspect="equal")
        row[0].set_ylabel(f"{method.title}, {method.particles}\ny − true y (m)")
    _save(figure, path)


def _save(figure: Figure, path: Path) -> None:
    figure.savefig(path, dpi=110)
