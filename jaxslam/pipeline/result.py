"""Base of the results of mapping and localization: stamps, timing, and display in a notebook."""

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float64

from jaxslam.pipeline.inputs import PreparedScans

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class AbstractResult(ABC):
    """Base of `RunResult` and `LocalizationResult`."""

    scans: PreparedScans
    compile_s: float
    run_s: float

    @property
    @abstractmethod
    def warnings(self) -> tuple[str, ...]:
        """Warnings, one line each."""

    @abstractmethod
    def plot(self, ax: "Axes | None" = None, *, truth: Any = None) -> "Axes":
        """Draw the result; needs matplotlib."""

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
