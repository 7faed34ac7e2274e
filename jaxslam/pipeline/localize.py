"""Localize the robot of a log on a known map."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax
import numpy as np
from jaxtyping import Bool, Float64, Int, PRNGKeyArray

from jaxslam.core import se2
from jaxslam.core.flags import Flag
from jaxslam.core.trajectory import Alignment
from jaxslam.core.validation import require_keys, require_types
from jaxslam.grid.known_map import KnownMap
from jaxslam.localization import AMCL, AMCLInfo, AMCLState
from jaxslam.localization.start import start_at
from jaxslam.pipeline.chunks import CHUNK, run_in_chunks
from jaxslam.pipeline.inputs import PreparedScans
from jaxslam.pipeline.result import AbstractResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from jaxslam.metrics import TrajectoryError

_MOVED, _TURNED = 1.0, np.pi / 6
"""Jump of the estimate relative to the odometry that counts as a move elsewhere, meters and radians."""

_CLOUD_EVERY = 3
"""Scans between two clouds of an animation; it is short because particles move fast."""


@dataclass(frozen=True)
class Cloud:
    """The particles during a localization.

    Attributes:
        estimates: `[t, 3]` estimated poses so far (m, m, rad, world frame).
        particles: `[n, 3]` current poses of the active particles.
        weights: `[n]` weights of these particles.
        stamp: stamp of the last processed scan, seconds.
    """

    estimates: Float64[np.ndarray, "t 3"]
    particles: Float64[np.ndarray, "n 3"]
    weights: Float64[np.ndarray, "n"]
    stamp: float

    def __repr__(self) -> str:
        return f"Cloud({len(self.particles)} particles after {len(self.estimates)} scans)"


@dataclass(frozen=True, repr=False)
class LocalizationResult(AbstractResult):
    """The result of a localization. A notebook shows it as a picture and a table.

    Attributes:
        scans: the processed scans and their configuration.
        map: the known map.
        scored_beams: largest number of beams of a scan that the sensor model scores.
        estimates: `[T, 3]` mean of the heaviest cluster at the processed scans (m, m, rad, world frame).
        covariances: `[T, 3, 3]` covariance of that cluster (m², m·rad, rad²).
        all_poses: `[S, 3]` pose at every scan: the estimate at the last processed scan, extended by odometry.
            It uses no later scan, so a robot could have computed it at that time.
        particles: `[n, 3]` final poses of the active particles.
        weights: `[n]` final weights of these particles, normalized.
        infos: diagnostics of every step, NumPy arrays `[T, ...]`.
        odometry: `[T, 3]` odometry poses at the processed scans.
        compile_s: seconds spent compiling; close to 0 after an earlier run of the same sizes.
        run_s: seconds spent running, without compilation.
    """

    scans: PreparedScans
    map: KnownMap
    scored_beams: int
    estimates: Float64[np.ndarray, "T 3"]
    covariances: Float64[np.ndarray, "T 3 3"]
    all_poses: Float64[np.ndarray, "S 3"]
    particles: Float64[np.ndarray, "n 3"]
    weights: Float64[np.ndarray, "n"]
    infos: AMCLInfo
    odometry: Float64[np.ndarray, "T 3"]
    compile_s: float
    run_s: float

    def _facts(self) -> list[str]:
        found = f"converged after {self.converged_after_s:.3g} s" if self.agreed.any() else "not converged"
        lost = ["lost at the end"] if self.agreed.any() and not self.converged else []
        return [found, *lost, f"{len(self.particles)} particles at the end"]

    def _rows(self) -> dict[str, str]:
        return {
            "scans": f"{len(self.stamps)} processed of {len(self.all_stamps)}",
            "particles": f"{self.infos.num_particles[0]} at first, {len(self.particles)} at the end",
            "converged": "yes" if self.converged else "no",
        }

    def plot(self, ax: "Axes | None" = None, *, truth: Any = None) -> "Axes":
        """Draw the map, the path where the particles agreed, and the final particles; needs matplotlib.

        The arguments are those of `RunResult.plot`; `truth` is in the map frame.
        """
        from jaxslam.viz.clouds import plot_localization

        return plot_localization(self, ax, truth=truth)

    def save(self, folder: Path | str) -> Path:
        """Write a folder as `RunResult.save` does, and return the path of its picture `cloud.png`."""
        from jaxslam.report.localization_folder import save_localization

        return save_localization(self, Path(folder))

    def error(self, truth: Any, *, align: Alignment = False) -> "TrajectoryError":
        """Return the error from the first agreement on, by default in the map frame; see `RunResult.error`.

        Raises:
            ValueError: the particles never agreed, or as `RunResult.error`.
        """
        from jaxslam.metrics.summary import reference_error

        if not self.agreed.any():
            raise ValueError("the particles never agreed, so there is no estimate: give a start pose")
        since = float(self.stamps[np.argmax(self.agreed)])
        return reference_error(truth, self.scans, self.all_poses, align=align, since=since)

    @property
    def agreed(self) -> Bool[np.ndarray, "T"]:
        """Steps at which the particles agree and the scan fits the map."""
        return np.asarray(self.infos.converged & ~self.infos.lost)

    @property
    def converged(self) -> bool:
        """Whether the particles agree in most of the last ten steps."""
        return bool(np.mean(self.agreed[-10:]) > 0.5)

    @property
    def converged_after_s(self) -> float:
        """Seconds from the first scan to the first agreement; NaN if the particles never agreed."""
        return float(self.stamps[np.argmax(self.agreed)] - self.stamps[0]) if self.agreed.any() else np.nan

    @property
    def kidnapped_events(self) -> int:
        """Number of agreements at a place that the odometry does not predict from the previous agreement.

        Either the robot was carried to another place, or one of the two estimates is wrong.
        """
        return len(find_jumps(self.estimates[self.agreed], self.odometry[self.agreed]))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings, one line each."""
        flags = np.asarray(self.infos.flags)
        few = int(np.count_nonzero(flags & Flag.FEW_VALID_BEAMS.value))
        broken = int(np.count_nonzero(flags & Flag.NONFINITE_POSE.value))
        lines = []
        if few:
            lines.append(
                f"{few} of {len(flags)} scans had too few returns: odometry alone moved the particles"
            )
        if broken:
            lines.append(f"in {broken} of {len(flags)} steps the odometry was not finite and was ignored")
        if self.kidnapped_events:
            lines.append(
                f"the estimate jumped to another place {self.kidnapped_events} times: either the robot was "
                "carried there, or an estimate was wrong, as on a map with many similar places"
            )
        if not self.converged:
            lines.append("the particles do not agree at the end: do not trust the trajectory")
        return tuple(lines)


def find_jumps(
    estimates: Float64[np.ndarray, "M 3"], odometry: Float64[np.ndarray, "M 3"]
) -> Int[np.ndarray, "_"]:
    """Return the indices of estimates that lie far from the previous estimate moved by the odometry.

    Args:
        estimates: `[M, 3]` (m, m, rad, world frame).
        odometry: `[M, 3]` odometry poses at the same times, in the odometry frame.
    """
    if len(estimates) < 2:
        return np.zeros(0, int)
    expected = se2.compose(estimates[:-1], se2.relative(odometry[:-1], odometry[1:]))
    moved = np.hypot(*(estimates[1:, :2] - expected[:, :2]).T) > _MOVED
    turned = np.abs(se2.wrap(estimates[1:, 2] - expected[:, 2])) > _TURNED
    return np.flatnonzero(moved | turned) + 1


def localize_log(
    amcl: AMCL,
    scans: PreparedScans,
    key: PRNGKeyArray,
    start: tuple[float, float, float] | None = None,
    *,
    deviations: tuple[float, float] = (0.5, 0.26),
    progress: bool = False,
    on_chunk: Callable[[Cloud], None] | None = None,
) -> LocalizationResult:
    """Localize a robot on a known map.

    Args:
        amcl: the filter, from `prepare_localization`.
        scans: the scans, from `prepare_localization`.
        key: PRNG key; same key, same bytes.
        start: start pose (m, m, rad, world frame); None searches the whole map.
        deviations: standard deviations of the start's x and y, meters, and of its heading, radians.
        progress: show a progress bar on stderr (needs tqdm).
        on_chunk: called with the particles every three scans.

    Raises:
        ValueError: the start lies outside the map or outside its free space.
    """
    wanted = "amcl and scans, as in `amcl, scans = jaxslam.prepare_localization(log, map)`"
    require_types("localize_log", amcl=(amcl, AMCL, wanted), scans=(scans, PreparedScans, wanted))
    require_keys("localize_log", key, 0, "jax.random.key(0)")
    # The steps count from 0 and never reach this index.
    key_start = jax.random.fold_in(key, 2**32 - 1)
    if start is None:
        state = jax.jit(AMCL.init_global)(amcl, key_start)
    else:
        state = start_at(amcl, key_start, start, deviations)

    def report(state: AMCLState, infos: list[AMCLInfo]) -> None:
        if on_chunk is not None:
            estimates = np.concatenate([info.estimate.mean for info in infos]).astype(float)
            stamp = float(scans.stamps[len(estimates) - 1])
            on_chunk(Cloud(estimates, *_active(state), stamp))

    finished = run_in_chunks(
        amcl,
        scans.inputs,
        key,
        state,
        tuned=False,
        progress="localizing" if progress else None,
        on_chunk=report,
        every=CHUNK if on_chunk is None else _CLOUD_EVERY,
    )
    estimates = finished.infos.estimate.mean.astype(float)
    last = np.searchsorted(scans.scan_index, scans.all_index, side="right") - 1
    odometry = scans.all_odometry[np.searchsorted(scans.all_index, scans.scan_index)]
    since = se2.relative(odometry[last], scans.all_odometry)
    particles, weights = _active(finished.state)
    return LocalizationResult(
        scans=scans,
        map=amcl.map,
        scored_beams=amcl.sensor.max_beams,
        estimates=estimates,
        covariances=finished.infos.estimate.covariance.astype(float),
        all_poses=se2.compose(estimates[last], since),
        particles=particles,
        weights=weights,
        infos=finished.infos,
        odometry=odometry,
        compile_s=finished.compile_s,
        run_s=finished.run_s,
    )


def _active(state: AMCLState) -> tuple[Float64[np.ndarray, "n 3"], Float64[np.ndarray, "n"]]:
    count = int(state.num_particles)
    weights = np.exp(np.asarray(state.log_weights)[:count])
    return np.asarray(state.poses, float)[:count], weights.astype(float)
