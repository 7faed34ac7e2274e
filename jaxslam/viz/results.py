"""Draw the result of a run."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from jaxslam.core import se2
from jaxslam.core.trajectory import Alignment
from jaxslam.metrics.summary import reference_frame
from jaxslam.pipeline.run import RunResult
from jaxslam.viz import style
from jaxslam.viz.maps import plot_map, plot_particles, plot_trajectory, plot_truth


def plot_run(
    result: RunResult, ax: Axes | None = None, *, truth: Any = None, align: Alignment = "se2"
) -> Axes:
    """Draw the map and the path of the best particle, and the final poses of all particles.

    The arguments are those of `RunResult.plot`, whose body this is.
    """
    ax = plot_path(result, ax, truth, align)
    plot_particles(result.particles, np.exp(result.log_weights.astype(float)), ax)
    style.add_legend_below(ax)
    return ax


def plot_path(run: Any, ax: Axes | None, truth: Any, align: Alignment) -> Axes:
    """Draw `log_odds` on the `grid` and the `trajectory` of a run, and the truth aligned with the run."""
    ax = style.axes_or_current(ax)
    plot_map(run.log_odds, run.grid.resolution, run.grid.origin, ax)
    plot_trajectory(run.trajectory, ax, label="estimated path", legend=False)
    if truth is not None:
        frame = reference_frame(truth, run.scans, run.all_poses, align)
        plot_truth(truth, ax, lambda poses: se2.compose(frame[None], poses))
    style.add_legend_below(ax)
    return ax
