"""The picture of a run, from what it leaves behind."""

import numpy as np
from matplotlib.axes import Axes

from jaxslam.pipeline.run import RunResult
from jaxslam.viz import style
from jaxslam.viz.maps import plot_map, plot_particles, plot_trajectory


def plot_run(
    result: RunResult,
    ax: Axes | None = None,
    *,
    label: str = "estimate",
    legend: bool = True,
) -> Axes:
    """Draws the best particle's map and its path, and where all particles are at the end.

    Args:
        result: of `jaxslam.pipeline.run.run_log`.
        ax: axes to draw on; None for pyplot's current ones.
        label: name of the path in the legend.
        legend: whether to add the legend.
    """
    ax = style.axes_or_current(ax)
    plot_map(result.log_odds, result.grid.resolution, result.grid.origin, ax)
    plot_trajectory(result.trajectory, ax, label=label, legend=False)
    plot_particles(result.particles, np.exp(result.log_weights.astype(float)), ax)
    if legend:
        style.add_legend(ax)
    return ax
