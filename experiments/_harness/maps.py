"""Maps of several methods in one figure, with the estimated and the true paths."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from experiments._harness.harness import Arrays
from experiments._harness.method import Method
from jaxslam.viz import plot_map, plot_trajectory


def draw_maps(
    path: Path, shown: Sequence[tuple[Method, Arrays]], shape: tuple[int, int], size: tuple[float, float]
) -> None:
    """Draw the map of the first seed for each method.

    Args:
        path: file to write.
        shown: the methods with their results.
        shape: rows and columns of the figure.
        size: width and height, inches.
    """
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(*shape, squeeze=False).ravel()
    for ax, (method, cell) in zip(axes, shown, strict=True):
        plot_map(cell["one_map"], float(cell["one_resolution"]), cell["one_origin"], ax)
        plot_trajectory(cell["one_path"], ax, label="estimate", legend=False)
        plot_trajectory(cell["one_truth"], ax, label="truth", color="black", linestyle="--", legend=False)
        ax.set_title(f"{method.title}, {method.particles} particles: IoU {cell['iou'][0]:.3f}")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
    figure.savefig(path, dpi=110)
