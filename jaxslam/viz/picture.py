"""Write the picture of a map with trajectory and particles, beside the truth."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Array, Float, Shaped
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxslam.viz import style
from jaxslam.viz.maps import Poses, plot_map, plot_particles, plot_trajectory


@dataclass(frozen=True)
class MapLayer:
    """A map and a trajectory on it.

    Attributes:
        occupancy: `[H, W]` probabilities, int8 log-odds or uint8 levels, see `map_levels`.
        resolution: side of a cell, meters.
        origin: `[2]` world position of the lower-left corner of cell (0, 0), meters.
        poses: `[M, 3]` trajectory (m, m, rad), or None.
    """

    occupancy: Shaped[np.ndarray | Array, "*shape"]
    resolution: float | Float[np.ndarray | Array, ""]
    origin: Float[np.ndarray | Array, "2"]
    poses: Poses | None = None


def save_map_picture(
    path: str | Path,
    occupancy: Shaped[np.ndarray | Array, "*shape"],
    resolution: float | Float[np.ndarray | Array, ""],
    origin: Float[np.ndarray | Array, "2"],
    *,
    poses: Poses | None = None,
    particles: Poses | None = None,
    weights: Float[np.ndarray | Array, "_"] | None = None,
    truth: MapLayer | Poses | None = None,
) -> None:
    """Write the picture of a map, in the format of the path's suffix (png, pdf, svg, …).

    Args:
        path: file to write; its folder must exist.
        occupancy: `[H, W]` probabilities, int8 log-odds or uint8 levels, see `map_levels`.
        resolution: side of a cell, meters.
        origin: `[2]` world position of the lower-left corner of cell (0, 0), meters.
        poses: `[M, 3]` estimated trajectory (m, m, rad), or None.
        particles: `[N, 3]` particle poses, usually the final ones, or None.
        weights: `[N]` particle weights, or None for equal weights.
        truth: true map and path in the same frame. They are drawn in a second panel of the same extent, and
            the path also over the estimate. Poses `[M, 3]` alone are drawn as a reference path.

    Raises:
        ValueError: an array cannot be drawn, or the format is unknown.
        OSError: the file cannot be written.
    """
    estimate = MapLayer(occupancy, resolution, origin, poses)
    layers = [estimate, truth] if isinstance(truth, MapLayer) else [estimate]
    drawn, label = (truth.poses, "true path") if isinstance(truth, MapLayer) else (truth, "reference path")
    figure = Figure(layout="constrained")
    panels = list(figure.subplots(1, len(layers), squeeze=False, sharex=True, sharey=True)[0])
    for panel, layer, name in zip(panels, layers, ("estimate", "truth"), strict=False):
        plot_map(layer.occupancy, layer.resolution, layer.origin, panel)
        panel.set_title(name, fontsize="medium")
    _fit_to_maps(figure, panels)
    if poses is not None:
        plot_trajectory(poses, panels[0], label="estimated path", legend=False)
    if drawn is not None:
        # Dashes over the solid line keep both visible where they coincide.
        for panel in panels:
            plot_trajectory(drawn, panel, label=label, color=style.REFERENCE, linestyle="--", legend=False)
    if particles is not None:
        plot_particles(particles, weights, panels[0])
    for panel in panels[1:]:
        panel.set_ylabel("")
    handles, labels = panels[0].get_legend_handles_labels()
    if labels:
        figure.legend(
            handles,
            labels,
            loc="outside lower center",
            ncols=min(len(labels), 5),
            frameon=False,
            fontsize="small",
        )
    figure.savefig(path, dpi=200)


def _fit_to_maps(figure: Figure, panels: list[Axes]) -> None:
    """Show the known parts of all maps in each panel, and size the figure for them, labels and legend."""
    lefts, rights, bottoms, tops = zip(*(panel.images[0].get_extent() for panel in panels), strict=True)
    left, right, bottom, top = min(lefts), max(rights), min(bottoms), max(tops)
    # All panels share these limits.
    panels[0].set(xlim=(left, right), ylim=(bottom, top))
    aspect = (top - bottom) / (right - left)
    width = 5.2 if aspect <= 1.5 else 5.2 * 1.5 / aspect
    height = float(np.clip(width * aspect, 1.2, 7.8))
    figure.set_size_inches(len(panels) * (max(width, 2.2) + 0.5), height + 1.1)
