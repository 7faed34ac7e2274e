"""The paper's figures 14 to 19: the corridor's map without the network, with it, and as it should be."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from experiments.harness import Arrays
from jaxslam.viz import plot_map, plot_trajectory


def draw_loops(path: Path, results: dict[str, Arrays], names: Sequence[str]) -> None:
    """Maps of the first trial, below the one from known poses and the one from many particles."""
    shown = [("from known poses, a lidar without bias", results["reference-known"])]
    shown += [("many particles on small loops, a lidar without bias", results["reference-built"])]
    for name in names:
        net, particles, *_ = name.split("-")
        cell = results[name]
        state = "closed" if cell["closed"][0] else "open"
        shown.append((f"{particles} particles, {net} the network: {state}", cell))
    figure = Figure(figsize=(9, 3.6 * len(shown)), layout="constrained")
    FigureCanvasAgg(figure)
    for ax, (title, cell) in zip(figure.subplots(len(shown), 1), shown, strict=True):
        plot_map(cell["one_map"], float(cell["one_resolution"]), cell["one_origin"], ax)
        plot_trajectory(cell["one_path"], ax, label="estimate", legend=False)
        plot_trajectory(cell["one_truth"], ax, label="truth", color="black", linestyle="--", legend=False)
        ax.set_title(title)
    figure.savefig(path, dpi=90)
