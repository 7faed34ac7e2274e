"""Run a filter over a log, and turn its flags into errors and warnings."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int, Int8, PRNGKeyArray

from jaxslam.config.slam import SlamConfig
from jaxslam.core.flags import Flag
from jaxslam.core.trajectory import Alignment, interpolate_along_odometry
from jaxslam.core.validation import require_keys, require_types
from jaxslam.grid.box import known_box
from jaxslam.grid.occupancy import LOG_ODDS_PER_UNIT
from jaxslam.grid.spec import GridSpec
from jaxslam.io.map_server import FREE_THRESHOLD, OCCUPIED_THRESHOLD, OccupancyMap
from jaxslam.pipeline.chunks import run_in_chunks
from jaxslam.pipeline.inputs import PreparedScans
from jaxslam.pipeline.result import AbstractResult
from jaxslam.slam.rbpf import RBPF, RBPFState, StepInfo

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FROM_PREPARE = "slam and scans, as in `slam, scans = jaxslam.prepare(log)`"
_MAP_MARGIN = 0.5
"""Unknown space kept around the known part of a map, meters."""

_WARNINGS = {
    Flag.OFF_MAP: "a particle reached the edge of the map, and space beyond the edge was not mapped",
    Flag.NONFINITE_WEIGHT: "particles with a NaN or infinite weight were dropped",
    Flag.NONFINITE_POSE: "particles with a NaN or infinite pose were moved by odometry instead",
    Flag.FEW_VALID_BEAMS: "scans had too few returns, so odometry alone moved the particles",
    Flag.MATCH_FAILED: "a particle's map explained too little of the scan, so odometry alone moved it",
}


class SlamError(ValueError):
    """An error that ends a run. The message is one line: what is wrong, when, and what to change."""


@dataclass(frozen=True)
class Snapshot:
    """The best particle during a run.

    Attributes:
        log_odds: `[H, W]` map of the best particle so far, fixed point.
        trajectory: `[t, 3]` poses of the best particle so far (m, m, rad).
        particles: `[N, 3]` current poses of all particles.
    """

    log_odds: Int8[np.ndarray, "H W"]
    trajectory: Float64[np.ndarray, "t 3"]
    particles: Float64[np.ndarray, "N 3"]

    def __repr__(self) -> str:
        return f"Snapshot({len(self.particles)} particles after {len(self.trajectory)} scans)"


@dataclass(frozen=True, repr=False)
class RunResult(AbstractResult):
    """The result of a run. A notebook shows it as a picture and a table.

    Attributes:
        scans: the processed scans and their configuration.
        trajectory: `[T, 3]` poses of the best particle at the processed scans (m, m, rad).
        all_poses: `[S, 3]` pose at every scan; odometry interpolates between processed scans.
        log_odds: `[H, W]` map of the best particle, fixed point.
        grid: position and cell size of the map.
        particles: `[N, 3]` final poses of all particles.
        log_weights: `[N]` final log-weights, normalized.
        infos: diagnostics of every step, NumPy arrays `[T, ...]`: particles, weights, effective sample size,
            resamplings, flags.
        compile_s: seconds spent compiling; close to 0 after an earlier run of the same sizes.
        run_s: seconds spent running, without compilation.
    """

    scans: PreparedScans
    trajectory: Float64[np.ndarray, "T 3"]
    all_poses: Float64[np.ndarray, "S 3"]
    log_odds: Int8[np.ndarray, "H W"]
    grid: GridSpec
    particles: Float64[np.ndarray, "N 3"]
    log_weights: Float32[np.ndarray, "N"]
    infos: StepInfo
    compile_s: float
    run_s: float

    def _facts(self) -> list[str]:
        height, width = self.log_odds.shape
        side = float(self.grid.resolution)
        return [f"{len(self.particles)} particles", f"map {width} × {height} cells of {side:.3g} m"]

    def _rows(self) -> dict[str, str]:
        height, width = self.log_odds.shape
        side = float(self.grid.resolution)
        return {
            "scans": f"{len(self.stamps)} processed of {self.scans.num_scans}",
            "particles": str(len(self.particles)),
            "map": f"{width * side:.1f} × {height * side:.1f} m, cells of {side:.3g} m",
            "resamplings": str(int(self.resampled.sum())),
        }

    def plot(self, ax: "Axes | None" = None, *, truth: Any = None, align: Alignment = "se2") -> "Axes":
        """Draw the map, the path and the particles; needs matplotlib.

        Args:
            ax: axes to draw on; None for pyplot's current ones.
            truth: true or reference trajectory, drawn dashed. It has `stamps` `[M]` and `poses` `[M, 3]`, as
                returned by `jaxslam.sim.drive` and `jaxslam.io.read_tum`. Its `walls` are drawn too if it has
                any.
            align: how `truth` is moved to the estimate's frame, as in `error`; False draws it unmoved.
        """
        from jaxslam.viz.results import plot_run

        return plot_run(self, ax, truth=truth, align=align)

    def save(self, folder: Path | str) -> Path:
        """Write map, trajectory, figures, metrics and configuration into a folder; needs the extra `cli`.

        The folder is created if needed. Existing files in it are overwritten.

        Returns:
            The path of `map.png`.
        """
        from jaxslam.report.folder import save_run

        return save_run(self, Path(folder))

    def occupancy(self) -> OccupancyMap:
        """Return the map for `prepare_localization`, cropped to its known part plus 0.5 m.

        A cell is occupied above a probability of 0.65 and free below 0.25, as in the map files that `save`
        writes. All other cells are unknown.
        """
        config = self.scans.config
        # float32 stores 0.05 as 0.0500000007: take the configured number.
        configured = config.map if isinstance(config, SlamConfig) else self.grid
        resolution = float(configured.resolution)
        box = known_box(self.log_odds, margin=round(_MAP_MARGIN / resolution))
        corner = np.asarray(self.grid.origin, np.float64) + resolution * np.array([box.column, box.row])
        probability = occupancy_probability(box.cut(self.log_odds))
        return OccupancyMap(
            occupied=probability > OCCUPIED_THRESHOLD,
            free=probability < FREE_THRESHOLD,
            resolution=resolution,
            origin=np.array([*np.round(corner, 6), 0.0]),
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about flagged steps, one line for each kind of flag."""
        counts = {text: np.count_nonzero(self.flags & flag.value) for flag, text in _WARNINGS.items()}
        return tuple(f"{count} of {len(self.flags)} steps: {text}" for text, count in counts.items() if count)

    @property
    def ess(self) -> Float32[np.ndarray, "T"]:
        """Effective sample size of every step before resampling."""
        return np.asarray(self.infos.ess)

    @property
    def resampled(self) -> Bool[np.ndarray, "T"]:
        """Steps at which the particles were resampled."""
        return np.asarray(self.infos.resampled)

    @property
    def flags(self) -> Int[np.ndarray, "T"]:
        """Bits of `jaxslam.core.flags.Flag` of every step."""
        return np.asarray(self.infos.flags)


def run_log(
    slam: RBPF,
    scans: PreparedScans,
    key: PRNGKeyArray,
    *,
    progress: bool = False,
    on_chunk: Callable[[Snapshot], None] | None = None,
    may_leave_map: bool = False,
) -> RunResult:
    """Run a filter over the scans of a log.

    Args:
        slam: the filter, from `prepare`.
        scans: the scans, from `prepare`.
        key: PRNG key; same key, same bytes.
        progress: show a progress bar on stderr (needs tqdm).
        on_chunk: called with the best particle every `jaxslam.pipeline.chunks.CHUNK` scans.
        may_leave_map: continue with a warning if the robot reaches the edge of the map. Comparisons of
            methods need this, so that a lost robot counts as an error of the trajectory.

    Raises:
        SlamError: the robot leaves the map.
    """
    require_types("run_log", slam=(slam, RBPF, FROM_PREPARE), scans=(scans, PreparedScans, FROM_PREPARE))
    require_keys("run_log", key, 0, "jax.random.key(0)")

    def check(state: RBPFState, infos: list[StepInfo]) -> None:
        if not may_leave_map:
            _raise_for_flags(infos, scans)
        if on_chunk is not None:
            on_chunk(_snapshot(state, infos))

    finished = run_in_chunks(
        slam,
        scans.inputs,
        key,
        jax.jit(RBPF.init)(slam, key, jnp.asarray(scans.pose0, jnp.float32)),
        tuned=True,
        progress="mapping" if progress else None,
        on_chunk=check,
    )
    best = _snapshot(finished.state, [finished.infos])
    return RunResult(
        scans=scans,
        trajectory=best.trajectory,
        all_poses=poses_at_every_scan(scans, best.trajectory),
        log_odds=best.log_odds,
        grid=slam.grid,
        particles=best.particles,
        log_weights=np.asarray(finished.state.log_weights),
        infos=finished.infos,
        compile_s=finished.compile_s,
        run_s=finished.run_s,
    )


def occupancy_probability(log_odds: Int8[np.ndarray, "H W"]) -> Float32[np.ndarray, "H W"]:
    """Convert log-odds `[H, W]` in fixed point to probabilities; NaN where a cell was never observed."""
    probability = 1 / (1 + np.exp(-LOG_ODDS_PER_UNIT * log_odds.astype(np.float32)))
    return np.where(log_odds == 0, np.float32(np.nan), probability.astype(np.float32))


def poses_at_every_scan(
    scans: PreparedScans, trajectory: Float64[np.ndarray, "T 3"]
) -> Float64[np.ndarray, "S 3"]:
    """Interpolate the poses at every scan of the log by odometry between the processed scans."""
    processed = np.searchsorted(scans.all_index, scans.scan_index)
    return interpolate_along_odometry(scans.all_odometry, processed, trajectory)


def _raise_for_flags(infos: list[StepInfo], scans: PreparedScans) -> None:
    off_map = np.flatnonzero(infos[-1].flags & Flag.OFF_MAP.value)
    if off_map.size:
        step = sum(len(info.flags) for info in infos[:-1]) + off_map[0]
        raise SlamError(
            f"the robot reached the edge of the map at scan {scans.scan_index[step]} (t = "
            f"{scans.stamps[step]:.3f} s): raise map.margin (--map-margin, meters around the odometry path)"
        )


def _snapshot(state: RBPFState, infos: list[StepInfo]) -> Snapshot:
    best = int(np.argmax(state.log_weights))
    return Snapshot(
        log_odds=np.asarray(state.maps[best]),
        trajectory=_read_back(infos, best),
        particles=np.asarray(state.poses, np.float64),
    )


def _read_back(infos: list[StepInfo], best: int) -> Float64[np.ndarray, "t 3"]:
    """Trace the ancestors of the best particle back to the first step, and return its poses."""
    ancestors = np.concatenate([info.ancestors for info in infos])
    poses = np.concatenate([info.poses for info in infos])
    path, slot = np.empty((len(poses), 3)), best
    for step in range(len(poses) - 1, -1, -1):
        slot = ancestors[step, slot]
        path[step] = poses[step, slot]
    return path
