"""Colors and small conventions shared by all pictures.

Colors are Okabe and Ito's, which stay apart for color-blind readers; every curve also differs in
line style or marker. Nothing here touches matplotlib's global settings.
"""

import numpy as np
from matplotlib.axes import Axes

ESTIMATE = "#0072B2"
REFERENCE = "#D55E00"
PARTICLES = "#CC79A7"
SCAN = "#009E73"
NEUTRAL = "#666666"

_CROWDED = 10_000
"""Points of an axes."""


def axes_or_current(ax: Axes | None) -> Axes:
    """The given axes, or pyplot's current ones: the only place that may touch a GUI backend."""
    if ax is not None:
        return ax
    import matplotlib.pyplot as plt

    return plt.gca()


def meter_axes(ax: Axes) -> None:
    """Equal scales and labels for a picture of the plane."""
    ax.set_aspect("equal")
    ax.set_xlabel("x (m)")
    ax.set_ylabel("y (m)")
    _frame(ax)


def curve_axes(ax: Axes, x_label: str, y_label: str) -> None:
    """Labels and a light grid for a curve."""
    ax.set_xlabel(x_label)
    ax.set_ylabel(y_label)
    ax.grid(True, color="0.9", linewidth=0.6)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)
    _frame(ax)


def add_legend(ax: Axes) -> None:
    """A legend if anything has a label."""
    if not ax.get_legend_handles_labels()[1]:
        return
    # To look for the place where it hides the least takes seconds then, and matplotlib warns of it.
    crowded = sum(np.size(line.get_xdata()) for line in ax.lines) > _CROWDED
    ax.legend(
        loc="upper left" if crowded else "best",
        frameon=True,
        framealpha=0.9,
        edgecolor="0.85",
        fontsize="small",
        fancybox=False,
    )


def _frame(ax: Axes) -> None:
    for spine in ax.spines.values():
        spine.set_color("0.6")
        spine.set_linewidth(0.6)
    ax.tick_params(color="0.6", labelsize="small", width=0.6)
