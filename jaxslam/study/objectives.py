"""The objectives that a study minimizes, computed from the runs of a trial."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float64


@dataclass(frozen=True)
class Figures:
    """Measurements of the runs of one configuration on one source; NaN where unknown.

    Attributes:
        error: `[S]` mean error of the relations, or RMSE of the trajectory, meters, by seed.
        heading: `[S]` the same for the heading, degrees.
        map_loss: `[S]` one minus the IoU of mapped and true walls; empty for a log.
        ms_per_scan: time per scan of one run, milliseconds.
    """

    error: Float64[np.ndarray, "S"]
    heading: Float64[np.ndarray, "S"]
    map_loss: Float64[np.ndarray, "_"]
    ms_per_scan: float


@dataclass(frozen=True)
class Objective:
    """An objective of a trial; smaller is better.

    Attributes:
        label: name with unit, for tables and axes.
        of: function that computes the objective from the figures of a source.
        needs: data that a source must have: "reference", "world" or "nothing".
    """

    label: str
    of: Callable[[Figures], float]
    needs: str

    def check(self, source: Any) -> None:
        """Raise `ValueError` if the source lacks the data for this objective."""
        measured = source.world is not None or source.relations is not None or source.reference is not None
        if self.needs == "reference" and not measured:
            raise ValueError(f"{source.name}: give relations or a reference, to measure the error against")
        if self.needs == "world" and source.world is None:
            raise ValueError(f"{source.name}: the objective map is for worlds: a log has no true map")


OBJECTIVES: dict[str, Objective] = {
    "error": Objective("error, m", lambda figures: float(figures.error.mean()), "reference"),
    "worst-error": Objective("worst error, m", lambda figures: float(figures.error.max()), "reference"),
    "heading": Objective("heading error, °", lambda figures: float(figures.heading.mean()), "reference"),
    "map": Objective("1 - IoU of walls", lambda figures: float(figures.map_loss.mean()), "world"),
    "time": Objective("time, ms per scan", lambda figures: figures.ms_per_scan, "nothing"),
}
"""Objectives by name: a mean over the sources, and over the seeds the mean or the worst."""
