"""Base of the results of mapping and localization: stamps, timing, and display in a notebook."""

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float64

from jaxslam.core.trajectory import Alignment
from jaxslam.pipeline.inputs import PreparedScans

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from jaxslam.metrics import TrajectoryError


class AbstractResult(ABC):
    """Base of `RunResult` and `LocalizationResult`."""

    scans: PreparedScans
    all_poses: Float64[np.ndarray, "S 3"]
    compile_s: float
    run_s: float

    @property
    @abstractmethod
    def warnings(self) -> tuple[str, ...]:
        """Warnings, one line each."""

    @abstractmethod
    def plot(self, ax: "Axes | None" = None, *, truth: Any = None) -> "Axes":
        """Draw the result; needs matplotlib."""

    def error(self, truth: Any, *, align: Alignment = "se2") -> "TrajectoryError":
        """Return the error of the trajectory: position (RMSE, mean, largest) and heading.

        Args:
            truth: true or reference trajectory. It has `stamps` `[M]` and `poses` `[M, 3]`, as returned by
                `jaxslam.sim.drive` and `jaxslam.io.read_tum`. Each of its poses is compared at its own time.
            align: "se2" moves the whole estimate for the least squared position error, "first_pose" moves its
                first pose to the truth's, False compares in the same frame.

        Raises:
            ValueError: fewer than two poses of `truth` lie within the trajectory, or the alignment is not
                determined.
        """
        from jaxslam.metrics.summary import reference_error

        return reference_error(truth, self.scans, self.all_poses, align=align)

    @abstractmethod
    def _facts(self) -> list[str]:
        """Return the main numbers for `repr`."""

    @abstractmethod
    def _rows(self) -> dict[str, str]:
        """Return the main numbers for the table of a notebook."""

    @property
    def stamps(self) -> Float64[np.ndarray, "T"]:
        """Stamps of the processed scans, seconds."""
        return self.scans.stamps

    @property
    def all_stamps(self) -> Float64[np.ndarray, "S"]:
        """Stamps of all scans, seconds."""
        return self.scans.all_stamps

    @property
    def ms_per_scan(self) -> float:
        """Run time per processed scan, milliseconds."""
        return 1e3 * self.run_s / len(self.stamps)

    def __repr__(self) -> str:
        facts = [f"{len(self.stamps)} scans", *self._facts(), f"{self.ms_per_scan:.3g} ms per scan"]
        facts += [f"{len(self.warnings)} warnings"] if self.warnings else []
        return f"{type(self).__name__}({', '.join(facts)})"

    def _repr_png_(self) -> bytes:
        from jaxslam.viz.notebook import result_png

        return result_png(self)

    def _repr_html_(self) -> str:
        from jaxslam.viz.notebook import result_html

        time = f"{self.ms_per_scan:.2f} ms per scan, {self.compile_s:.1f} s to compile"
        rows = {**self._rows(), "time": time}
        rows |= {"warnings": "; ".join(self.warnings)} if self.warnings else {}
        return result_html(self, rows)
