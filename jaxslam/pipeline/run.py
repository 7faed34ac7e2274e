"""Running a filter over a log, and what it leaves; flags turned into errors and warnings."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int, Int8, PRNGKeyArray

from jaxslam.core.flags import Flag
from jaxslam.core.trajectory import interpolate_along_odometry
from jaxslam.grid.spec import GridSpec
from jaxslam.pipeline.chunks import run_in_chunks
from jaxslam.pipeline.inputs import PreparedScans
from jaxslam.slam.rbpf import RBPF, RBPFState, StepInfo

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_WARNINGS = {
    Flag.OFF_MAP: "a particle reached the edge of the map, and nothing beyond it was mapped",
    Flag.NONFINITE_WEIGHT: "particles with a NaN or infinite weight were dropped",
    Flag.NONFINITE_POSE: "particles with a NaN or infinite pose were moved by odometry instead",
    Flag.FEW_VALID_BEAMS: "scans had too few returns, so odometry alone moved the particles",
    Flag.MATCH_FAILED: "a particle's map explained too little of the scan, so odometry alone moved it",
}


class SlamError(ValueError):
    """A run that cannot go on. The message is one line: what is wrong, when, what to do."""


@dataclass(frozen=True)
class Snapshot:
    """The best particle during a run, for those who watch.

    Attributes:
        log_odds: `[H, W]` its map so far.
        trajectory: `[t, 3]` its poses so far.
        particles: `[N, 3]` all particles now.
    """

    log_odds: Int8[np.ndarray, "H W"]
    trajectory: Float64[np.ndarray, "t 3"]
    particles: Float64[np.ndarray, "N 3"]

    def __repr__(self) -> str:
        return f"Snapshot({len(self.particles)} particles after {len(self.trajectory)} scans)"


@dataclass(frozen=True)
class RunResult:
    """The result of a run; it draws itself in a notebook.

    Attributes:
        scans: the scans that were mapped, and their configuration.
        trajectory: `[T, 3]` poses of the best particle at the processed scans (m, m, rad).
        all_poses: `[S, 3]` pose at every scan; odometry connects the processed ones.
        log_odds: `[H, W]` map of the best particle, fixed point.
        grid: where that map lies.
        particles: `[N, 3]` final poses.
        log_weights: `[N]` final, normalized.
        infos: the record of every step, NumPy arrays `[T, ...]`: particles, weights, effective sample size,
            resamplings, flags.
        compile_s: seconds spent compiling; almost none after an earlier run of the same sizes.
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

    def __repr__(self) -> str:
        height, width = self.log_odds.shape
        parts = [
            f"{len(self.stamps)} scans",
            f"{len(self.particles)} particles",
            f"map {width} × {height} cells of {float(self.grid.resolution):.3g} m",
            f"{self.ms_per_scan:.3g} ms per scan",
        ]
        parts += [f"{len(self.warnings)} warnings"] if self.warnings else []
        return f"RunResult({', '.join(parts)})"

    def _repr_html_(self) -> str:
        from jaxslam.viz.notebook import run_html

        return run_html(self)

    def _repr_png_(self) -> bytes:
        from jaxslam.viz.notebook import run_png

        return run_png(self)

    def plot(self, ax: "Axes | None" = None, *, truth: Any = None) -> "Axes":
        """Draw the map, the path and the particles; needs matplotlib.

        Args:
            ax: axes to draw on; None for pyplot's current ones.
            truth: the true or reference trajectory, drawn dashed: anything with `stamps` `[M]` and `poses`
                `[M, 3]`, as `jaxslam.sim.drive` and `jaxslam.io.read_tum` return; its `walls`, if it has
                any, are drawn too.
        """
        from jaxslam.viz.results import plot_run

        return plot_run(self, ax, truth=truth)

    def save(self, folder: Path | str) -> Path:
        """Write map, trajectory, figures, metrics and configuration into a folder; needs the extra `cli`.

        The folder is made if it does not exist. Files in it are overwritten.

        Returns:
            The path of `map.png`.
        """
        from jaxslam.report.folder import save_run

        return save_run(self, Path(folder))

    @property
    def stamps(self) -> Float64[np.ndarray, "T"]:
        """Seconds, processed scans."""
        return self.scans.stamps

    @property
    def all_stamps(self) -> Float64[np.ndarray, "S"]:
        """Seconds, every scan."""
        return self.scans.all_stamps

    @property
    def ms_per_scan(self) -> float:
        """`run_s` per processed scan, milliseconds."""
        return 1e3 * self.run_s / len(self.stamps)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What went wrong in some of the steps, one line for each kind."""
        counts = {flag: int(np.count_nonzero(self.flags & flag.value)) for flag in _WARNINGS}
        return tuple(
            f"{count} of {len(self.flags)} steps: {_WARNINGS[flag]}"
            for flag, count in counts.items()
            if count
        )

    @property
    def ess(self) -> Float32[np.ndarray, "T"]:
        """Effective sample size before resampling."""
        return np.asarray(self.infos.ess)

    @property
    def resampled(self) -> Bool[np.ndarray, "T"]:
        """Where it was resampled."""
        return np.asarray(self.infos.resampled)

    @property
    def flags(self) -> Int[np.ndarray, "T"]:
        """`jaxslam.core.flags.Flag` bits."""
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
        may_leave_map: continue at the edge of the map with a warning. Comparisons of methods need this: a
            robot that is lost there counts as an error and does not end the run.

    Raises:
        SlamError: the robot leaves the map.
    """

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


def poses_at_every_scan(
    scans: PreparedScans, trajectory: Float64[np.ndarray, "T 3"]
) -> Float64[np.ndarray, "S 3"]:
    """Poses at every scan of the log: odometry carries on between those that were processed."""
    processed = np.searchsorted(scans.all_index, scans.scan_index)
    return interpolate_along_odometry(scans.all_odometry, processed, trajectory)


def _raise_for_flags(infos: list[StepInfo], scans: PreparedScans) -> None:
    off_map = np.flatnonzero(infos[-1].flags & Flag.OFF_MAP.value)
    if off_map.size:
        step = sum(len(info.flags) for info in infos[:-1]) + off_map[0]
        stamp = scans.stamps[step]
        raise SlamError(
            f"the robot reached the edge of the map at scan {scans.scan_index[step]} "
            f"(t = {stamp:.3f} s): enlarge it with --map-margin (meters around the odometry's path)"
        )


def _snapshot(state: RBPFState, infos: list[StepInfo]) -> Snapshot:
    best = int(np.argmax(state.log_weights))
    return Snapshot(
        log_odds=np.asarray(state.maps[best]),
        trajectory=_read_back(infos, best),
        particles=np.asarray(state.poses, np.float64),
    )


def _read_back(infos: list[StepInfo], best: int) -> Float64[np.ndarray, "t 3"]:
    ancestors = np.concatenate([info.ancestors for info in infos])
    poses = np.concatenate([info.poses for info in infos])
    path, slot = np.empty((len(poses), 3)), best
    for step in range(len(poses) - 1, -1, -1):
        slot = ancestors[step, slot]
        path[step] = poses[step, slot]
    return path
