"""Maps of the corridor with and without the network (figures 14 to 16 of Jamaludin et al.)."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from experiments._harness.harness import Arrays
from jaxslam.viz import plot_map, plot_trajectory


def draw_loops(path: Path, results: dict[str, Arrays], names: tuple[str, str]) -> None:
    """Draw the two reference maps, and below them one map without and one with the network.

    The trial is the first one in which only one of the two methods closes the loop. If no trial differs,
    trial 0 is drawn with its paths.
    """
    shown: list[tuple[str, Arrays, int | None]] = [
        ("from known poses, a lidar without bias", results["reference-known"], None),
        ("many particles on small loops, a lidar without bias", results["reference-built"], None),
    ]
    closed = [results[name]["closed"].astype(bool) for name in names]
    differing = np.flatnonzero(closed[0] != closed[1])
    trial = int(differing[0]) if len(differing) else None
    for name in names:
        net, particles, *_ = name.split("-")
        state = "closed" if results[name]["closed"][trial or 0] else "open"
        shown.append(
            (f"{particles} particles, {net} the network, trial {trial or 0}: {state}", results[name], trial)
        )
    figure = Figure(figsize=(9, 3.6 * len(shown)), layout="constrained")
    for ax, (title, cell, which) in zip(figure.subplots(len(shown), 1), shown, strict=True):
        log_odds = cell["one_map"] if which is None else cell["maps"][which]
        plot_map(log_odds, float(cell["one_resolution"]), cell["one_origin"], ax)
        # Paths are kept for trial 0 only.
        if not which:
            plot_trajectory(cell["one_path"], ax, label="estimate", legend=False)
            plot_trajectory(cell["one_truth"], ax, label="truth", color="black", linestyle="--", legend=False)
        ax.set_title(title)
    figure.savefig(path, dpi=90)
