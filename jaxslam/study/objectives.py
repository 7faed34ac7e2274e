"""What a study makes small, taken from the runs of a trial."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float64


@dataclass(frozen=True)
class Figures:
    """What the runs of one configuration on one source were worth; NaN where it cannot be told.

    Attributes:
        error: `[S]` mean error of the relations, or RMSE of the trajectory, meters, by seed.
        heading: `[S]` the same of headings, degrees.
        map_loss: `[S]` one minus the walls' IoU with the true ones; empty for a log.
        ms_per_scan: of one run, milliseconds.
    """

    error: Float64[np.ndarray, "S"]
    heading: Float64[np.ndarray, "S"]
    map_loss: Float64[np.ndarray, "_"]
    ms_per_scan: float


@dataclass(frozen=True)
class Objective:
    """A figure of a trial; smaller is better.

    Attributes:
        label: with its unit, for tables and axes.
        of: from the figures of a source.
        needs: what a source must have.
    """

    label: str
    of: Callable[[Figures], float]
    needs: str

    def check(self, source: Any) -> None:
        """Raise `ValueError` for a source that it cannot be told of."""
        measured = source.world is not None or source.relations is not None or source.reference is not None
        if self.needs == "reference" and not measured:
            raise ValueError(f"{source.name}: give it relations or a reference, to measure the error by")
        if self.needs == "world" and source.world is None:
            raise ValueError(f"{source.name}: the objective map is for worlds: of a log no map is known")


OBJECTIVES: dict[str, Objective] = {
    "error": Objective("error, m", lambda figures: float(figures.error.mean()), "reference"),
    "worst-error": Objective("worst error, m", lambda figures: float(figures.error.max()), "reference"),
    "heading": Objective("heading error, °", lambda figures: float(figures.heading.mean()), "reference"),
    "map": Objective("1 - IoU of walls", lambda figures: float(figures.map_loss.mean()), "world"),
    "time": Objective("time, ms per scan", lambda figures: figures.ms_per_scan, "nothing"),
}
"""By name. Of several sources the mean counts, over seeds the mean or the worst."""


def values(objectives: tuple[str, ...], by_source: list[Figures]) -> list[float]:
    """Return the objectives of a trial."""
    return [float(np.mean([OBJECTIVES[name].of(figures) for figures in by_source])) for name in objectives]
