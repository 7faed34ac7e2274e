"""The figures 7 and 8 of Yang et al. 2019, and curves of the particles, drawn from the results."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from experiments._harness.harness import Arrays
from experiments._harness.maps import draw_maps
from experiments.coal_mine.methods import DRAWN, MAPPED


def draw_roadways(path: Path, results: dict[str, Arrays]) -> None:
    """Draw the roadway by the traditional and by the optimized filter (figures 7 and 8)."""
    draw_maps(path, [(MAPPED[name], results[f"map-{name}"]) for name in DRAWN], (len(DRAWN), 1), (10, 8))


def draw_particles(path: Path, results: dict[str, Arrays]) -> None:
    """Draw error, effective sample size and ancestors over time: mean and range over seeds."""
    figure = Figure(figsize=(9, 8), layout="constrained")
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


def draw_localization(path: Path, results: dict[str, Arrays], carried_at: int) -> None:
    """Draw the number of particles and the share of robots found over the updates.

    Args:
        path: file to write.
        results: cells by name.
        carried_at: the step at which a robot is kidnapped.
    """
    figure = Figure(figsize=(10, 6.5), layout="constrained")
    panels = figure.subplots(2, 2, sharex="col")
    for column, task in enumerate(("global", "kidnapped")):
        for which, color in (("true", "tab:blue"), ("built", "tab:orange")):
            if f"{task}-{which}" not in results:
                continue
            cell = results[f"{task}-{which}"]
            counts, position = (
                cell[key].reshape(-1, cell[key].shape[-1]) for key in ("num_particles", "position")
            )
            steps = np.arange(counts.shape[1])
            panels[0, column].semilogy(steps, np.median(counts, axis=0), color=color, label=f"{which} map")
            low, high = np.percentile(counts, (10, 90), axis=0)
            panels[0, column].fill_between(steps, low, high, color=color, alpha=0.2, linewidth=0)
            panels[1, column].plot(steps, (position < 0.5).mean(axis=0), color=color, label=f"{which} map")
        titles = {"global": "global start", "kidnapped": f"kidnapped at step {carried_at}"}
        panels[0, column].set_title(titles[task])
        panels[1, column].set(xlabel="update", ylim=(0, 1.02))
    panels[0, 0].set_ylabel("particles: median, 10 to 90 %")
    panels[1, 0].set_ylabel("share of robots within 0.5 m")
    panels[0, 0].legend(fontsize="small")
    for ax in panels.ravel():
        ax.grid(alpha=0.3)
    figure.savefig(path, dpi=110)
