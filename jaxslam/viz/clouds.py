"""Draw a localization: particles and path on the known map, curves over time, an animation."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float, Float32, Float64
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxslam.core import se2
from jaxslam.grid.known_map import KnownMap
from jaxslam.pipeline.localize import Cloud, LocalizationResult
from jaxslam.viz import style
from jaxslam.viz.animation import MapFrame, animate_map
from jaxslam.viz.maps import plot_map, plot_particles, plot_scan, plot_trajectory, plot_truth

_MAX_DRAWN = 5000
"""Largest number of particles in a picture; more would only overlap."""


def plot_localization(
    result: LocalizationResult, ax: Axes | None = None, *, truth: Any = None, legend: bool = True
) -> Axes:
    """Draw the map, the path where the particles agreed, the last scan and the final particles.

    The arguments are those of `LocalizationResult.plot`; `legend` adds a legend below the axes.
    """
    ax, map = style.axes_or_current(ax), result.map
    plot_map(map_levels_of(map), map.resolution, np.asarray(map.origin[:2]), ax, margin_m=0.5)
    agreed = result.estimates.copy()
    # Without an estimate, the path has a gap instead of a line across the map.
    agreed[~result.agreed] = np.nan
    if result.agreed.any():
        plot_trajectory(in_map_axes(map, agreed), ax, label="where the particles agree", legend=False)
    if truth is not None:
        plot_truth(truth, ax, lambda poses: in_map_axes(map, poses))
    last = in_map_axes(map, result.estimates[-1:])[0]
    plot_scan(jax.tree.map(lambda leaf: leaf[-1], result.scans.inputs.scan), last, ax, label="last scan")
    count = min(len(result.particles), _MAX_DRAWN)
    heaviest = np.argsort(-result.weights, kind="stable")[:count]
    plot_particles(in_map_axes(map, result.particles[heaviest]), result.weights[heaviest], ax)
    if legend:
        style.add_legend_below(ax)
    return ax


def save_localization_curves(path: Path, result: LocalizationResult) -> None:
    """Write a picture of the number of particles, their spread and the inlier ratio over time."""
    figure = Figure(figsize=(8.0, 6.0), layout="constrained")
    counts, spread, match = figure.subplots(3, 1, sharex=True)
    seconds = result.stamps - result.stamps[0]
    counts.semilogy(seconds, result.infos.num_particles, color="tab:blue")
    counts.set_ylabel("particles")
    deviation = np.sqrt(result.covariances[:, 0, 0] + result.covariances[:, 1, 1])
    spread.semilogy(seconds, np.maximum(deviation, 1e-3), color="tab:blue")
    spread.set_ylabel("deviation of the\nestimate (m)")
    match.plot(seconds, result.infos.match_score, color="tab:blue")
    match.set(ylabel="inlier ratio", ylim=(0.0, 1.02), xlabel="time (s)")
    for ax in (counts, spread, match):
        ax.fill_between(
            seconds, 0, 1, where=~result.agreed, transform=ax.get_xaxis_transform(), color="0.9", linewidth=0
        )
        ax.grid(alpha=0.3)
    counts.set_title("gray: the particles do not agree, or the scan does not fit", fontsize="medium")
    figure.savefig(path, dpi=150)


def animate_clouds(path: Path, map: KnownMap, clouds: Sequence[Cloud]) -> None:
    """Write an animated GIF of the particles on the map."""
    levels, first = map_levels_of(map), clouds[0].stamp
    frames = (
        MapFrame(
            levels,
            in_map_axes(map, cloud.estimates[-1:]),
            # Particles are independent samples, so the first particles represent all of them.
            in_map_axes(map, cloud.particles[:_MAX_DRAWN]),
            f"{cloud.stamp - first:.0f} s, {len(cloud.particles)} particles",
        )
        for cloud in clouds
    )
    animate_map(path, frames, map.resolution, np.asarray(map.origin[:2]), frame_s=0.2)


def map_levels_of(map: KnownMap) -> Float32[np.ndarray, "H W"]:
    """Convert a known map to probabilities for `plot_map`: 1 occupied, 0 free, NaN unknown."""
    levels = np.full(map.shape, np.nan, np.float32)
    levels.reshape(-1)[np.asarray(map.free)] = 0.0
    levels[np.asarray(map.occupied)] = 1.0
    return levels


def in_map_axes(map: KnownMap, poses: Float[np.ndarray | Array, "_ 3"]) -> Float64[np.ndarray, "_ 3"]:
    """Convert world poses to a drawing of the map, which is upright even if the map frame is rotated."""
    origin = np.asarray(map.origin, np.float64)
    corner = np.array([*origin[:2], 0.0])
    return se2.compose(corner[None], se2.relative(origin[None], np.asarray(poses, float)))
