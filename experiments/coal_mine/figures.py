"""The paper's figures 7 and 8, and what happens to the particles, drawn from the results."""

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from experiments.coal_mine.methods import DRAWN, MAPPED
from experiments.harness import Arrays
from jaxslam.viz import plot_map, plot_trajectory


def draw_maps(path: Path, results: dict[str, Arrays]) -> None:
    """Figures 7 and 8: the roadway by the traditional filter and by the optimised one, seed 0."""
    figure = Figure(figsize=(10, 8), layout="constrained")
    FigureCanvasAgg(figure)
    for ax, name in zip(figure.subplots(len(DRAWN), 1), DRAWN, strict=True):
        cell, method = results[f"map-{name}"], MAPPED[name]
        plot_map(cell["one_map"], float(cell["one_resolution"]), cell["one_origin"], ax)
        plot_trajectory(cell["one_path"], ax, label="estimate")
        plot_trajectory(cell["one_truth"], ax, label="truth", color="black", linestyle="--")
        ax.set_title(f"{method.title}, {method.particles} particles: IoU {cell['iou'][0]:.3f}")
    figure.savefig(path, dpi=110)


def draw_particles(path: Path, results: dict[str, Arrays]) -> None:
    """Error, effective sample size and ancestors over time, mean over seeds and ± one deviation."""
    figure = Figure(figsize=(9, 8), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(3, 1, sharex=True)
    for name, color in DRAWN.items():
        cell, method = results[f"map-{name}"], MAPPED[name]
        for ax, key in zip(panels, ("position", "ess", "ancestors"), strict=True):
            scale = 1.0 if key != "ancestors" else 1.0 / method.particles
            mean, std = cell[key].mean(axis=0) * scale, cell[key].std(axis=0) * scale
            ax.plot(cell["one_times"], mean, color=color, label=f"{method.title}, {method.particles}")
            low = np.maximum(mean - std, 1e-3 if key == "position" else 0.0)
            ax.fill_between(cell["one_times"], low, mean + std, color=color, alpha=0.2, linewidth=0)
    panels[0].set(ylabel="position error, m", yscale="log")
    panels[1].set(ylabel="N_eff / N", ylim=(0, 1.02))
    panels[2].set(ylabel="ancestors 50 steps ago,\nshare of N", ylim=(0, 1.02), xlabel="time, s")
    panels[0].legend(fontsize="small")
    for ax in panels:
        ax.grid(alpha=0.3)
    figure.savefig(path, dpi=110)


def draw_localisation(path: Path, results: dict[str, Arrays]) -> None:
    """Live particles and share of robots found, step by step: KLD sampling and recovery at work."""
    figure = Figure(figsize=(10, 6.5), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(2, 2, sharex="col")
    for column, task in enumerate(("global", "kidnapped")):
        for which, color in (("true", "tab:blue"), ("built", "tab:orange")):
            if f"{task}-{which}" not in results:
                continue
            cell = results[f"{task}-{which}"]
            live, position = (cell[key].reshape(-1, cell[key].shape[-1]) for key in ("live", "position"))
            steps = np.arange(live.shape[1])
            panels[0, column].semilogy(steps, np.median(live, axis=0), color=color, label=f"{which} map")
            low, high = np.percentile(live, (10, 90), axis=0)
            panels[0, column].fill_between(steps, low, high, color=color, alpha=0.2, linewidth=0)
            panels[1, column].plot(steps, (position < 0.5).mean(axis=0), color=color, label=f"{which} map")
        panels[0, column].set(title={"global": "global start", "kidnapped": "kidnapped at step 60"}[task])
        panels[1, column].set(xlabel="update", ylim=(0, 1.02))
    panels[0, 0].set_ylabel("live particles: median, 10 to 90 %")
    panels[1, 0].set_ylabel("share of robots within 0.5 m")
    panels[0, 0].legend(fontsize="small")
    for ax in panels.ravel():
        ax.grid(alpha=0.3)
    figure.savefig(path, dpi=110)
