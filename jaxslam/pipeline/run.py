"""Running a filter over a log, and what it leaves; flags turned into errors and warnings."""

from collections.abc import Callable
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Float32, Float64, Int, Int8, PRNGKeyArray

from jaxslam.core.flags import Flag
from jaxslam.core.trajectory import poses_along
from jaxslam.core.types import StepInputs
from jaxslam.grid.spec import GridSpec
from jaxslam.pipeline.chunks import Advanced, advance
from jaxslam.pipeline.inputs import PreparedInputs
from jaxslam.slam.rbpf import RBPF, RBPFState, StepInfo


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
    """What a run leaves behind.

    Attributes:
        stamps: `[T]` seconds, processed scans.
        trajectory: `[T, 3]` poses of the best particle at them (m, m, rad).
        all_stamps: `[S]` seconds, every scan.
        all_poses: `[S, 3]` pose at every scan: where none was processed, odometry between those that were.
        log_odds: `[H, W]` map of the best particle, fixed point.
        grid: where that map lies.
        particles: `[N, 3]` final poses.
        log_weights: `[N]` final, normalised.
        infos: what every step left behind, NumPy arrays `[T, ...]`: particles, weights, effective sample
            size, resamplings, flags.
        compile_s: seconds spent compiling; next to none if a run of the same sizes has been before.
        run_s: seconds spent running, compilation apart.
        ms_per_scan: `run_s` per processed scan, milliseconds.
        warnings: one line each.
    """

    stamps: Float64[np.ndarray, "T"]
    trajectory: Float64[np.ndarray, "T 3"]
    all_stamps: Float64[np.ndarray, "S"]
    all_poses: Float64[np.ndarray, "S 3"]
    log_odds: Int8[np.ndarray, "H W"]
    grid: GridSpec
    particles: Float64[np.ndarray, "N 3"]
    log_weights: Float32[np.ndarray, "N"]
    infos: StepInfo
    compile_s: float
    run_s: float
    ms_per_scan: float
    warnings: tuple[str, ...]

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


def run(
    slam: RBPF, key: PRNGKeyArray, pose0: Float[Array, "3"], inputs: StepInputs
) -> tuple[RBPFState, StepInfo]:
    """The whole log as one `lax.scan`: jit it, vmap it over keys or over the floats of `slam`.

    On the CPU it is the faster by a quarter if `compiler_options` of `jaxslam.xla.compiler` are given to `jit`.

    Args:
        slam: the filter.
        key: PRNG key; step `t` uses `fold_in(key, t)`.
        pose0: `[3]` start pose (m, m, rad, world frame).
        inputs: leaves stacked over time, `[T, ...]`.

    Returns:
        The final state and the infos `[T, ...]`; `trajectory(infos, argmax(log_weights))` reads a path back.
    """

    def step(state: RBPFState, inputs: StepInputs) -> tuple[RBPFState, StepInfo]:
        return slam.step(jax.random.fold_in(key, state.num_steps), state, inputs)

    return jax.lax.scan(step, slam.init(key, pose0), inputs)


def run_log(
    slam: RBPF,
    key: PRNGKeyArray,
    prepared: PreparedInputs,
    *,
    progress: bool = False,
    on_chunk: Callable[[Snapshot], None] | None = None,
    may_leave_map: bool = False,
) -> RunResult:
    """Runs a filter over a prepared log on the host: same result as `run`, in chunks.

    Args:
        slam: the filter, its map sized for this log.
        key: PRNG key; same key, same bytes.
        prepared: from `prepare_inputs`.
        progress: show a progress bar on stderr (needs tqdm).
        on_chunk: called with the state of affairs every `jaxslam.pipeline.chunks.CHUNK` scans.
        may_leave_map: go on at the edge of the map, and warn: for comparisons, in which a robot that is
            lost is a figure and not the end.

    Raises:
        SlamError: if the robot leaves the map.
    """
    pose0 = jnp.asarray(prepared.pose0, jnp.float32)

    def look(state: RBPFState, infos: list[StepInfo]) -> None:
        if not may_leave_map:
            _raise_for_flags(infos, prepared)
        if on_chunk is not None:
            on_chunk(_snapshot(state, infos))

    advanced = advance(
        slam,
        key,
        jax.jit(RBPF.init)(slam, key, pose0),
        prepared.inputs,
        tuned=True,
        progress="mapping" if progress else None,
        look=look,
    )
    return _result(slam, advanced, prepared)


def poses_at_every_scan(
    prepared: PreparedInputs, trajectory: Float64[np.ndarray, "T 3"]
) -> Float64[np.ndarray, "S 3"]:
    """Poses at every scan of the log: odometry carries on between those that were processed."""
    processed = np.searchsorted(prepared.all_index, prepared.scan_index)
    return poses_along(prepared.all_odometry, processed, trajectory)


def _raise_for_flags(infos: list[StepInfo], prepared: PreparedInputs) -> None:
    off_map = np.flatnonzero(infos[-1].flags & Flag.OFF_MAP.value)
    if off_map.size:
        step = sum(len(info.flags) for info in infos[:-1]) + off_map[0]
        stamp = prepared.stamps[step]
        raise SlamError(
            f"the robot reached the edge of the map at scan {prepared.scan_index[step]} "
            f"(t = {stamp:.3f} s): enlarge it with --map-margin (metres around the odometry's path)"
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


def _result(slam: RBPF, advanced: Advanced, prepared: PreparedInputs) -> RunResult:
    state, infos = advanced.state, advanced.infos
    snapshot = _snapshot(state, [infos])
    return RunResult(
        stamps=prepared.stamps,
        trajectory=snapshot.trajectory,
        all_stamps=prepared.all_stamps,
        all_poses=poses_at_every_scan(prepared, snapshot.trajectory),
        log_odds=snapshot.log_odds,
        grid=slam.grid,
        particles=snapshot.particles,
        log_weights=np.asarray(state.log_weights),
        infos=infos,
        compile_s=advanced.compile_s,
        run_s=advanced.run_s,
        ms_per_scan=1e3 * advanced.run_s / len(infos.flags),
        warnings=_warnings(infos.flags),
    )


def _warnings(flags: Int[np.ndarray, "T"]) -> tuple[str, ...]:
    messages = {
        Flag.OFF_MAP: "a particle reached the edge of the map, and nothing beyond it was mapped",
        Flag.NONFINITE_WEIGHT: "particles with a NaN or infinite weight were dropped",
        Flag.NONFINITE_POSE: "particles with a NaN or infinite pose were put back to the odometry",
        Flag.FEW_VALID_BEAMS: "scans had too few returns, so odometry alone moved the particles",
        Flag.MATCH_FAILED: "a particle's map explained too little of the scan, so odometry alone moved it",
    }
    counts = {flag: int(np.count_nonzero(flags & flag.value)) for flag in messages}
    return tuple(
        f"{counts[flag]} of {len(flags)} steps: {messages[flag]}" for flag in messages if counts[flag]
    )
