"""Draw curves over time: errors and the effective sample size."""

from typing import Literal

import numpy as np
from jaxtyping import Array, Bool, Float
from matplotlib.axes import Axes

from jaxslam.viz import style


def plot_errors(
    stamps: Float[np.ndarray | Array, "_"],
    errors: Float[np.ndarray | Array, "*seeds _"],
    band: Float[np.ndarray | Array, "*edges _"] | None = None,
    ax: Axes | None = None,
    *,
    quantity: Literal["position", "heading"] = "position",
    label: str | None = None,
    color: str = style.ESTIMATE,
    linestyle: str = "-",
) -> Axes:
    """Draw an error over time: of one run, or the mean over seeds with a band of ± 1 standard deviation.

    Args:
        stamps: `[M]` seconds.
        errors: `[M]`, or `[S, M]` for `S` seeds, meters, or radians for headings (drawn in degrees). A seed
            with NaN is left out at that stamp; if all seeds are NaN, the curve has a gap.
        band: `[M]` half width of the band in the unit of `errors`, or `[2, M]` its lower and upper edge,
            which suits a logarithmic axis; None for the standard deviation over seeds.
        ax: axes to draw on; None for pyplot's current ones.
        quantity: "position" or "heading".
        label: name in the legend; None for no legend.
        color: color of line and band.
        linestyle: style of the line.

    Raises:
        ValueError: the shapes do not match, or the quantity is unknown.
    """
    ax = style.axes_or_current(ax)
    times, values = np.asarray(stamps, float), np.asarray(errors, float)
    if quantity not in ("position", "heading"):
        raise ValueError(f"quantity is {quantity!r}: give 'position' or 'heading'")
    if values.ndim not in (1, 2) or values.shape[-1] != len(times):
        raise ValueError(f"errors have shape {values.shape} for {len(times)} stamps: give [M] or [seeds, M]")
    seeds = np.ma.masked_invalid(np.atleast_2d(values))
    mean, deviation = seeds.mean(axis=0).filled(np.nan), seeds.std(axis=0).filled(np.nan)
    edges = None
    if band is not None:
        given = np.asarray(band, float)
        if given.shape not in (times.shape, (2, *times.shape)):
            raise ValueError(f"band has shape {given.shape} for {len(times)} stamps: give [M] or [2, M]")
        edges = given if given.ndim == 2 else np.stack([mean - given, mean + given])
    elif values.ndim == 2 and len(values) > 1:
        edges = np.stack([mean - deviation, mean + deviation])
    scale = 180 / np.pi if quantity == "heading" else 1.0
    ax.plot(times, scale * mean, linestyle, color=color, linewidth=1.3, label=label)
    if edges is not None:
        low, high = scale * edges
        # A distance is never negative, but its mean minus its standard deviation can be.
        low = np.maximum(low, 0.0) if (values[np.isfinite(values)] >= 0).all() else low
        ax.fill_between(times, low, high, color=color, alpha=0.2, linewidth=0)
    style.curve_axes(ax, "time (s)", "position error (m)" if quantity == "position" else "heading error (°)")
    style.add_legend(ax)
    return ax


def plot_ess(
    ess: Float[np.ndarray | Array, "_"],
    num_particles: int,
    resampled: Bool[np.ndarray | Array, "_"] | None = None,
    ax: Axes | None = None,
    *,
    threshold: float | None = 0.5,
) -> Axes:
    """Draw the effective sample size per step, with the threshold and the resampled steps.

    Args:
        ess: `[T]` effective sample size, 1 to `num_particles`.
        num_particles: number of particles `N`, the top of the axis.
        resampled: `[T]` steps after which the filter resampled; None if unknown.
        ax: axes to draw on; None for pyplot's current ones.
        threshold: fraction of `N` below which the filter resamples; None if unknown.

    Raises:
        ValueError: the lengths differ, or `num_particles` is below 1.
    """
    ax = style.axes_or_current(ax)
    values = np.asarray(ess, float)
    if num_particles < 1:
        raise ValueError(f"num_particles is {num_particles}: give 1 or more")
    steps = np.arange(len(values))
    ax.plot(steps, values, color=style.ESTIMATE, linewidth=1.0, label="ESS")
    if threshold is not None:
        label = f"threshold {threshold:g} N"
        level = threshold * num_particles
        ax.axhline(level, color=style.NEUTRAL, linestyle="--", linewidth=0.9, label=label)
    if resampled is not None:
        marked = np.asarray(resampled, bool)
        if marked.shape != values.shape:
            raise ValueError(f"{len(marked)} resampled flags for {len(values)} steps: give one each")
        ax.plot(
            steps[marked],
            np.zeros(marked.sum()),
            "|",
            color=style.REFERENCE,
            markersize=9,
            label=f"resampled ({marked.sum()})",
            # Without clipping, an empty set of marks would count as a mark at the corner of the picture and
            # shift the axes.
            clip_on=not marked.any(),
        )
    ax.set_ylim(0, 1.04 * num_particles)
    style.curve_axes(ax, "step", f"effective sample size (of {num_particles})")
    style.add_legend(ax)
    return ax
