"""Draw the map, and paths, walls, particles and scans on it."""

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Array, Float, Shaped, UInt8
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.image import AxesImage

from jaxslam.core import se2
from jaxslam.core.types import LidarScan
from jaxslam.grid.box import known_box
from jaxslam.viz import style
from jaxslam.viz.raster import UNKNOWN_GRAY, gray_ramp, map_levels, shrink

Poses = Float[np.ndarray | Array, "_ 3"]


class MapImage(AxesImage):
    """A map image that is pooled to the available pixels at each draw.

    Walls therefore stay visible at any figure size, dpi and zoom, and zooming in shows every cell.
    """

    def __init__(
        self,
        ax: Axes,
        levels: UInt8[np.ndarray, "_ _"],
        extent: tuple[float, float, float, float],
    ) -> None:
        super().__init__(ax, origin="lower", interpolation="nearest", extent=extent)
        self._levels = levels
        self._ramp = gray_ramp()
        self._set_pixels(levels)

    def draw(self, renderer: Any) -> None:
        """Draw at the resolution of the renderer, which for vector formats is not a `RendererBase`."""
        left, right, bottom, top = self.get_extent()
        corners = self.axes.transData.transform([[left, bottom], [right, top]])
        # Vector formats draw at 72 dpi and embed images with this magnification.
        width, height = np.abs(corners[1] - corners[0]) * renderer.get_image_magnification()
        pooled = shrink(self._levels, max(int(height), 1), max(int(width), 1))
        if self.get_shape() != pooled.shape:
            self._set_pixels(pooled)
        super().draw(renderer)

    def _set_pixels(self, levels: UInt8[np.ndarray, "_ _"]) -> None:
        self.set_data(np.repeat(self._ramp[levels][..., None], 3, axis=-1))


def plot_map(
    occupancy: Shaped[np.ndarray | Array, "*shape"],
    resolution: float | Float[np.ndarray | Array, ""],
    origin: Float[np.ndarray | Array, "2"],
    ax: Axes | None = None,
    *,
    margin_m: float = 0.5,
) -> Axes:
    """Draw a map: free white, occupied black, unknown gray, cropped to its known part.

    Args:
        occupancy: `[H, W]` probabilities, int8 log-odds or uint8 levels, see `map_levels`.
        resolution: side of a cell, meters.
        origin: `[2]` world position of the lower-left corner of cell (0, 0), meters.
        ax: axes to draw on; None for pyplot's current ones.
        margin_m: unknown space kept around the known part, meters.

    Raises:
        ValueError: the map or the resolution is invalid.
    """
    ax = style.axes_or_current(ax)
    levels = map_levels(occupancy)
    side = checked_resolution(resolution)
    box = known_box(levels, margin=round(margin_m / side))
    image = MapImage(ax, box.cut(levels), box.extent(side, np.asarray(origin, float)))
    image.set_clip_path(ax.patch)
    ax.add_image(image)
    # This call extends the limits of the axes to the image; the constructor does not.
    image.set_extent(image.get_extent())
    # Space beyond the image is unknown too.
    ax.set_facecolor(str(UNKNOWN_GRAY / 255))
    style.meter_axes(ax)
    return ax


def plot_trajectory(
    poses: Poses,
    ax: Axes | None = None,
    *,
    label: str = "trajectory",
    color: str = style.ESTIMATE,
    linestyle: str = "-",
    legend: bool = True,
) -> Axes:
    """Draw a path with its start (circle) and end (square).

    Args:
        poses: `[M, 3]` (m, m, rad). Rows that are not finite leave a gap.
        ax: axes to draw on; None for pyplot's current ones.
        label: name in the legend.
        color: color of line and markers.
        linestyle: style of the line, so that two paths also differ in black and white.
        legend: whether to add the legend.

    Raises:
        ValueError: no pose is finite.
    """
    ax = style.axes_or_current(ax)
    path = np.asarray(poses, float)
    is_finite = np.isfinite(path).all(axis=1)
    finite = path[is_finite]
    if len(finite) == 0:
        raise ValueError(f"none of the {len(path)} poses is finite: there is no path to draw")
    gapped = np.where(is_finite[:, None], path, np.nan)
    ax.plot(gapped[:, 0], gapped[:, 1], linestyle, color=color, linewidth=1.2, label=label)
    known = ax.get_legend_handles_labels()[1]
    for pose, marker, name in ((finite[0], "o", "start"), (finite[-1], "s", "end")):
        ax.plot(
            *pose[:2],
            marker,
            color=color,
            markerfacecolor="white",
            markersize=5,
            markeredgewidth=1.2,
            label=None if name in known else name,
            zorder=3,
        )
    style.meter_axes(ax)
    if legend:
        style.add_legend(ax)
    return ax


def plot_walls(
    segments: Float[np.ndarray | Array, "_ 4"],
    ax: Axes | None = None,
    *,
    label: str = "true walls",
    color: str = style.NEUTRAL,
) -> Axes:
    """Draw the walls of a known world as thin lines over a map.

    Args:
        segments: `[S, 4]` end points x1, y1, x2, y2 in meters, as in a simulated world.
        ax: axes to draw on; None for pyplot's current ones.
        label: name in a legend.
        color: color of the lines.

    Raises:
        ValueError: a segment is not finite.
    """
    ax = style.axes_or_current(ax)
    ends = np.asarray(segments, float)
    if not np.isfinite(ends).all():
        raise ValueError(
            f"segment {int(np.argmin(np.isfinite(ends).all(axis=1)))} is not finite: give finite meters"
        )
    lines = LineCollection(list(ends.reshape(-1, 2, 2)), colors=color, linewidths=0.7, label=label)
    ax.add_collection(lines)
    ax.autoscale_view()
    style.meter_axes(ax)
    return ax


def plot_truth(truth: Any, ax: Axes, move: Callable[[Poses], Poses]) -> None:
    """Draw the `poses` of a truth dashed, and its `walls` if it has any; `move` maps poses to the axes."""
    if getattr(truth, "walls", None) is not None:
        ends = np.pad(np.asarray(truth.walls, float).reshape(-1, 2), ((0, 0), (0, 1)))
        plot_walls(move(ends)[:, :2].reshape(-1, 4), ax)
    path = move(np.asarray(truth.poses, float))
    plot_trajectory(path, ax, label="true path", color=style.REFERENCE, linestyle="--", legend=False)


def plot_particles(
    poses: Poses,
    weights: Float[np.ndarray | Array, "_"] | None = None,
    ax: Axes | None = None,
    *,
    tick_m: float = 0.25,
    color: str = style.PARTICLES,
    label: str = "particles",
) -> Axes:
    """Draw particles as dots with heading ticks; particles with less weight are fainter.

    Args:
        poses: `[N, 3]` (m, m, rad). Rows that are not finite are left out.
        weights: `[N]` not negative, at any scale; None for equal weights.
        ax: axes to draw on; None for pyplot's current ones.
        tick_m: length of the heading tick, meters.
        color: color of dots and ticks.
        label: name in a legend.

    Raises:
        ValueError: the number of weights is wrong, or a weight is negative or not finite.
    """
    ax = style.axes_or_current(ax)
    cloud = np.asarray(poses, float)
    share = np.ones(len(cloud)) if weights is None else np.asarray(weights, float)
    if len(share) != len(cloud):
        raise ValueError(f"{len(share)} weights for {len(cloud)} particles: give one for each")
    if not (np.isfinite(share).all() and (share >= 0).all()):
        raise ValueError("weights must be finite and not negative: give weights, not log-weights")
    finite = np.isfinite(cloud).all(axis=1)
    cloud, share = cloud[finite], share[finite]
    # The legend shows the color of a particle with full weight, regardless of the first particle.
    ax.plot([], [], "o", color=color, markersize=3.5, label=label)
    style.meter_axes(ax)
    if len(cloud) == 0:
        return ax
    # Particles with the least weight stay visible, because positions matter more than weights here.
    alpha = 0.4 + 0.6 * share / max(share.max(), np.finfo(float).tiny)
    heading = np.stack([np.cos(cloud[:, 2]), np.sin(cloud[:, 2])], axis=1)
    ticks = np.stack([cloud[:, :2], cloud[:, :2] + tick_m * heading], axis=1)
    # Draw over the markers of a path, which would otherwise hide a converged cloud.
    lines = LineCollection(list(ticks), colors=color, alpha=alpha, linewidths=0.8, zorder=3.5)
    ax.add_collection(lines)
    ax.scatter(cloud[:, 0], cloud[:, 1], s=7, color=color, alpha=alpha, linewidths=0, zorder=3.5)
    return ax


def plot_scan(
    scan: LidarScan,
    pose_world_base: Float[np.ndarray | Array, "3"] | None = None,
    ax: Axes | None = None,
    *,
    color: str = style.SCAN,
    label: str = "scan",
) -> Axes:
    """Draw the end points of the valid beams of a scan in the world frame, and the lidar as a cross.

    Args:
        scan: ranges `[B]` in meters and mask `[B]`.
        pose_world_base: `[3]` pose of the base (m, m, rad); None for the base frame itself.
        ax: axes to draw on; None for pyplot's current ones.
        color: color of the points.
        label: name in a legend.

    Raises:
        ValueError: the pose is not finite.
    """
    ax = style.axes_or_current(ax)
    base = np.zeros(3) if pose_world_base is None else np.asarray(pose_world_base, float)
    if not np.isfinite(base).all():
        raise ValueError(f"pose_world_base is {base}: give finite meters and radians")
    lidar = se2.compose(base, np.asarray(scan.pose_base_lidar, float))
    valid = np.asarray(scan.valid)
    bearing = lidar[2] + np.asarray(scan.angles(), float)[valid]
    ranges = np.asarray(scan.ranges, float)[valid]
    x, y = lidar[0] + ranges * np.cos(bearing), lidar[1] + ranges * np.sin(bearing)
    ax.scatter(x, y, s=4, color=color, linewidths=0, label=label, zorder=2.5)
    ax.plot(lidar[0], lidar[1], "+", color=color, markersize=7)
    style.meter_axes(ax)
    return ax


def checked_resolution(resolution: float | Float[np.ndarray | Array, ""]) -> float:
    """Return the side of a cell as a float.

    Raises:
        ValueError: it is not a positive finite number.
    """
    side = float(resolution)
    if not (np.isfinite(side) and side > 0):
        raise ValueError(f"resolution is {side}: give a positive number of meters")
    return side
