"""Draw the result of a run."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from jaxslam.pipeline.run import RunResult
from jaxslam.viz import style
from jaxslam.viz.maps import plot_map, plot_particles, plot_trajectory, plot_walls


def plot_run(result: RunResult, ax: Axes | None = None, *, truth: Any = None) -> Axes:
    """Draw the map and the path of the best particle, and the final poses of all particles.

    Args:
        result: result of `jaxslam.run_log`.
        ax: axes to draw on; None for pyplot's current ones.
        truth: true or reference trajectory with `stamps` and `poses`, drawn dashed. Its `walls` are drawn too
            if it has any.
    """
    ax = style.axes_or_current(ax)
    plot_map(result.log_odds, result.grid.resolution, result.grid.origin, ax)
    if getattr(truth, "walls", None) is not None:
        plot_walls(truth.walls, ax)
    plot_trajectory(result.trajectory, ax, label="estimate", legend=False)
    if truth is not None:
        plot_trajectory(truth.poses, ax, label="truth", color=style.REFERENCE, linestyle="--", legend=False)
    plot_particles(result.particles, np.exp(result.log_weights.astype(float)), ax)
    style.add_legend_below(ax)
    return ax
