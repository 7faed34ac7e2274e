"""Colors and conventions shared by all pictures.

The colors are those of Okabe and Ito, which color-blind readers can distinguish. Every curve also differs in
line style or marker. This module does not change matplotlib's global settings.
"""

import numpy as np
from matplotlib.axes import Axes

ESTIMATE = "#0072B2"
REFERENCE = "#D55E00"
PARTICLES = "#CC79A7"
SCAN = "#009E73"
NEUTRAL = "#666666"

_CROWDED = 10_000
"""Number of points above which the best place of a legend takes seconds to find."""


def axes_or_current(ax: Axes | None) -> Axes:
    """Return the given axes, or pyplot's current ones. No other function may start a GUI backend."""
    if ax is not None:
        return ax
    import matplotlib.pyplot as plt

    return plt.gca()


def meter_axes(ax: Axes) -> None:
    """Set equal scales and the labels of a picture of the plane."""
    ax.set_aspect("equal")
    ax.set_xlabel("x (m)")
    ax.set_ylabel("y (m)")
    _frame(ax)


def curve_axes(ax: Axes, x_label: str, y_label: str) -> None:
    """Set the labels and a light grid for a curve."""
    ax.set_xlabel(x_label)
    ax.set_ylabel(y_label)
    ax.grid(True, color="0.9", linewidth=0.6)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)
    _frame(ax)


def add_legend(ax: Axes) -> None:
    """Add a legend if anything has a label."""
    if not ax.get_legend_handles_labels()[1]:
        return
    # With many points, the search for the best place takes seconds and matplotlib warns about it.
    crowded = sum(np.size(line.get_xdata()) for line in ax.lines) > _CROWDED
    ax.legend(
        loc="upper left" if crowded else "best",
        frameon=True,
        framealpha=0.9,
        edgecolor="0.85",
        fontsize="small",
        fancybox=False,
    )


def add_legend_below(ax: Axes) -> None:
    """Add a legend below the axes, where it covers no data, if any artist has a label."""
    count = len(ax.get_legend_handles_labels()[1])
    if not count:
        return
    # The padding, in units of the font size, leaves room for tick labels and axis label.
    ax.legend(
        loc="upper center",
        bbox_to_anchor=(0.5, 0.0),
        borderaxespad=4.5,
        ncols=min(count, 4),
        frameon=False,
        fontsize="small",
    )


def _frame(ax: Axes) -> None:
    for spine in ax.spines.values():
        spine.set_color("0.6")
        spine.set_linewidth(0.6)
    ax.tick_params(color="0.6", labelsize="small", width=0.6)
