"""The paper's figures 7 and 8, and what happens to the particles, drawn from the results."""

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from experiments.coal_mine.methods import DRAWN, MAPPED
from experiments.harness import Arrays
from experiments.maps import draw_maps


def draw_roadways(path: Path, results: dict[str, Arrays]) -> None:
    """Figures 7 and 8: the roadway by the traditional filter and by the optimised one."""
    draw_maps(path, [(MAPPED[name], results[f"map-{name}"]) for name in DRAWN], (len(DRAWN), 1), (10, 8))


def draw_particles(path: Path, results: dict[str, Arrays]) -> None:
    """Error, effective sample size and ancestors over time: mean over seeds, and from least to most."""
    figure = Figure(figsize=(9, 8), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(3, 1, sharex=True)
    for name, color in DRAWN.items():
        cell, method = results[f"map-{name}"], MAPPED[name]
        for ax, key in zip(panels, ("position", "ess", "ancestors"), strict=True):
            scale = 1.0 if key != "ancestors" else 1.0 / method.particles
            times, over_seeds = cell["one_times"], cell[key] * scale
            label = f"{method.title}, {method.particles}"
            ax.plot(times, over_seeds.mean(axis=0), color=color, label=label)
            low, high = over_seeds.min(axis=0), over_seeds.max(axis=0)
            ax.fill_between(times, low, high, color=color, alpha=0.2, linewidth=0)
    panels[0].set(ylabel="position error, m", yscale="log", ylim=(1e-3, None))
    panels[1].set(ylabel="N_eff / N", ylim=(0, 1.02))
    panels[2].set(ylabel="ancestors 50 steps ago,\nshare of N", ylim=(0, 1.02), xlabel="time, s")
    panels[0].legend(fontsize="small")
    for ax in panels:
        ax.grid(alpha=0.3)
    figure.savefig(path, dpi=110)


def draw_localisation(path: Path, results: dict[str, Arrays], carried_at: int) -> None:
    """Live particles and share of robots found, step by step: KLD sampling and recovery at work.

    Args:
        path: of the picture.
        results: cells by name.
        carried_at: the step at which a kidnapped robot is carried off.
    """
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
        titles = {"global": "global start", "kidnapped": f"kidnapped at step {carried_at}"}
        panels[0, column].set_title(titles[task])
        panels[1, column].set(xlabel="update", ylim=(0, 1.02))
    panels[0, 0].set_ylabel("live particles: median, 10 to 90 %")
    panels[1, 0].set_ylabel("share of robots within 0.5 m")
    panels[0, 0].legend(fontsize="small")
    for ax in panels.ravel():
        ax.grid(alpha=0.3)
    figure.savefig(path, dpi=110)
