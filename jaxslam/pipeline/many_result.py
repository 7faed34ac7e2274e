"""The results of many runs: errors against a truth, pictures, and a table for a notebook."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int, Int8

from jaxslam.core.flags import Flag
from jaxslam.core.trajectory import Alignment
from jaxslam.grid.spec import GridSpec
from jaxslam.pipeline.inputs import PreparedScans
from jaxslam.pipeline.run import poses_at_every_scan

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True)
class ManyResult:
    """The results of `C × S` runs: `C` configurations and `S` keys. A notebook shows them as a table.

    `T` is the number of scans of the longest input.

    Attributes:
        scans: the scans that all runs processed, or one element for each key.
        configs: the `C` values of each setting in which the configurations differ, by its full name.
        grids: position and cell size of the maps of each configuration.
        trajectories: `[C, S, T, 3]` poses of the best particle (m, m, rad); NaN after the end of an input.
        ess: `[C, S, T]` effective sample size before resampling.
        resampled: `[C, S, T]` steps at which the particles were resampled.
        flags: `[C, S, T]` bits of `jaxslam.core.flags.Flag`.
        log_odds: `[C, S, H, W]` map of the best particle, fixed point; None unless maps were requested.
        compile_s: seconds spent compiling; close to 0 after earlier runs of the same sizes.
        run_s: seconds spent running, without compilation.
        scans_per_s: processed scans of all runs per second of `run_s`.
        ms_per_scan: milliseconds per scan of one run while the other runs of its call run in parallel.
        truth: the truth given to `run_many`, or None.
    """

    scans: tuple[PreparedScans, ...]
    configs: Mapping[str, Sequence[Any]]
    grids: tuple[GridSpec, ...]
    trajectories: Float32[np.ndarray, "C S T 3"]
    ess: Float32[np.ndarray, "C S T"]
    resampled: Bool[np.ndarray, "C S T"]
    flags: Int[np.ndarray, "C S T"]
    log_odds: Int8[np.ndarray, "C S H W"] | None
    compile_s: float
    run_s: float
    scans_per_s: float
    ms_per_scan: float
    truth: Any = None

    @property
    def stamps(self) -> Float64[np.ndarray, "S T"]:
        """Stamps of the processed scans for each key, seconds; NaN after the end of an input."""
        _, num_keys, total, _ = self.trajectories.shape
        each = [self.scans[s % len(self.scans)].stamps for s in range(num_keys)]
        return np.stack([np.pad(one, (0, total - len(one)), constant_values=np.nan) for one in each])

    def errors(self, truth: Any = None, *, align: Alignment = "se2") -> Float64[np.ndarray, "C S"]:
        """Return the RMSE of the position in each run, meters, as `RunResult.error` measures it.

        Args:
            truth: as for `RunResult.error`, or one for each key; None for the one given to `run_many`.
            align: as for `RunResult.error`.

        Raises:
            ValueError: the number of truths is wrong, or as `RunResult.error`.
        """
        from jaxslam.metrics.summary import reference_error

        truth, (num_configs, num_keys) = self.truth if truth is None else truth, self.left_map.shape
        truths = [truth] * num_keys if hasattr(truth, "stamps") else list(truth or ())
        if len(truths) != num_keys:
            raise ValueError(f"{len(truths)} truths for {num_keys} keys: give one truth, or one for each key")

        def rmse(c: int, s: int) -> float:
            run = self._run(c, s)
            return reference_error(truths[s], run.scans, run.all_poses, align=align).rmse_m

        return np.array([[rmse(c, s) for s in range(num_keys)] for c in range(num_configs)])

    def plot(
        self, c: int = 0, s: int = 0, ax: "Axes | None" = None, *, truth: Any = None, align: Alignment = "se2"
    ) -> "Axes":
        """Draw the map and the path of run `(c, s)`, as `RunResult.plot` does; needs matplotlib.

        Raises:
            ValueError: no maps were kept.
        """
        from jaxslam.viz.results import plot_path

        if self.log_odds is None:
            raise ValueError("no maps were kept: give maps=True to run_many")
        return plot_path(self._run(c, s), ax, truth, align)

    def _run(self, c: int, s: int) -> SimpleNamespace:
        """Return one run under the names of `RunResult`."""
        scans = self.scans[s % len(self.scans)]
        path = self.trajectories[c, s, : len(scans.stamps)].astype(np.float64)
        return SimpleNamespace(
            scans=scans,
            trajectory=path,
            all_poses=poses_at_every_scan(scans, path),
            log_odds=None if self.log_odds is None else self.log_odds[c, s],
            grid=self.grids[c],
        )

    @property
    def left_map(self) -> Bool[np.ndarray, "C S"]:
        """Runs in which a particle reached the edge of its map; `run_log` would have raised an error."""
        return np.any(self.flags & Flag.OFF_MAP.value, axis=-1)

    def __repr__(self) -> str:
        count, seeds, total, _ = self.trajectories.shape
        return (
            f"ManyResult({count} configurations × {seeds} keys × {total} scans, "
            f"{self.scans_per_s:.0f} scans per second)"
        )

    def _repr_html_(self) -> str:
        from jaxslam.viz.notebook import table_html

        num_configs, num_keys, num_scans, _ = self.trajectories.shape
        rows = {
            "runs": f"{num_configs} configurations × {num_keys} keys",
            "scans": f"{num_scans} in the longest run",
            "time": f"{self.scans_per_s:.0f} scans per second, {self.compile_s:.1f} s to compile",
            "left the map": f"{int(self.left_map.sum())} of {self.left_map.size} runs",
        }
        errors = None if self.truth is None else self.errors()
        for c in range(num_configs):
            swept = [f"{name} = {values[c]:g}" for name, values in self.configs.items()]
            left = f"{int(self.left_map[c].sum())} of {num_keys} runs left the map"
            error = "" if errors is None else f"RMSE {errors[c].mean():.3f} ± {errors[c].std():.3f} m, "
            rows[", ".join([f"configuration {c}", *swept])] = error + left
        return table_html(rows)
