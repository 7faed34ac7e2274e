"""Localizing a log in a map, and what that leaves."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import jax
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int, PRNGKeyArray

from jaxslam.core import se2
from jaxslam.core.flags import Flag
from jaxslam.grid.known_map import KnownMap
from jaxslam.localization import AMCL, AMCLInfo, AMCLState
from jaxslam.localization.start import start_at
from jaxslam.pipeline.chunks import CHUNK, run_in_chunks
from jaxslam.pipeline.inputs import PreparedScans

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MOVED, _TURNED = 1.0, np.pi / 6
"""An estimate that jumps so far, meters or radians, past what the odometry says has settled elsewhere."""

_CLOUD_EVERY = 3
"""Scans between two clouds: particles move faster than a map grows."""


@dataclass(frozen=True)
class Cloud:
    """The particles during a localization, for those who watch.

    Attributes:
        estimates: `[t, 3]` so far.
        particles: `[n, 3]` those that live now.
        weights: `[n]` of them.
        stamp: seconds, of the last scan.
    """

    estimates: Float64[np.ndarray, "t 3"]
    particles: Float64[np.ndarray, "n 3"]
    weights: Float64[np.ndarray, "n"]
    stamp: float

    def __repr__(self) -> str:
        return f"Cloud({len(self.particles)} particles after {len(self.estimates)} scans)"


@dataclass(frozen=True)
class LocalizationResult:
    """What a localization leaves behind.

    Attributes:
        scans: the scans that were used, and their configuration.
        map: the known map.
        scored_beams: beams of a scan that the sensor model scores, at most.
        estimates: `[T, 3]` the heaviest cluster at them (m, m, rad, world frame).
        covariances: `[T, 3, 3]` its covariance (m², m·rad, rad²).
        all_poses: `[S, 3]` pose at every scan: the last processed one's, carried on by odometry. No later
            scan is looked at: it is what a robot would have known there and then.
        particles: `[n, 3]` those that live at the end.
        weights: `[n]` of them, normalized.
        infos: what every step left behind, NumPy arrays `[T, ...]`.
        odometry: `[T, 3]` odometry pose at the processed scans.
        compile_s: seconds spent compiling; next to none if a run of the same sizes has been before.
        run_s: seconds spent running, compilation apart.
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

    def __repr__(self) -> str:
        found = f"converged after {self.converged_after_s:.3g} s" if self.agreed.any() else "not converged"
        parts = [
            f"{len(self.stamps)} scans",
            found if self.converged or not self.agreed.any() else f"{found}, lost at the end",
            f"{len(self.particles)} particles at the end",
            f"{self.ms_per_scan:.3g} ms per scan",
        ]
        parts += [f"{len(self.warnings)} warnings"] if self.warnings else []
        return f"LocalizationResult({', '.join(parts)})"

    def _repr_html_(self) -> str:
        from jaxslam.viz.notebook import localization_html

        return localization_html(self)

    def _repr_png_(self) -> bytes:
        from jaxslam.viz.notebook import localization_png

        return localization_png(self)

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw the map, the path where the particles agreed, and the last particles; needs matplotlib."""
        from jaxslam.viz.localization import plot_localization

        return plot_localization(self, ax)

    def save(self, folder: Path | str) -> Path:
        """Write trajectory, pictures, metrics and configuration into a folder; needs the extra `cli`.

        The folder is made if it does not exist. Files in it are overwritten.

        Returns:
            The path of `cloud.png`.
        """
        from jaxslam.report.localization_folder import save_localization

        return save_localization(self, Path(folder))

    @property
    def stamps(self) -> Float64[np.ndarray, "T"]:
        """Seconds, processed scans."""
        return self.scans.stamps

    @property
    def all_stamps(self) -> Float64[np.ndarray, "S"]:
        """Seconds, every scan."""
        return self.scans.all_stamps

    @property
    def agreed(self) -> Bool[np.ndarray, "T"]:
        """Where the particles agree and the scan lies on the map."""
        return np.asarray(self.infos.converged & ~self.infos.lost)

    @property
    def converged(self) -> bool:
        """Whether they do at the end: in most of the last ten steps."""
        return bool(np.mean(self.agreed[-10:]) > 0.5)

    @property
    def converged_after_s(self) -> float:
        """Seconds from the first scan to the first agreement; NaN if there was none."""
        return float(self.stamps[np.argmax(self.agreed)] - self.stamps[0]) if self.agreed.any() else np.nan

    @property
    def kidnapped_events(self) -> int:
        """How often the particles agreed, and next agreed on a place that the odometry does not lead to.

        The robot was carried off in between, or one of the two places was wrong.
        """
        return len(settled_elsewhere(self.estimates[self.agreed], self.odometry[self.agreed]))

    @property
    def ms_per_scan(self) -> float:
        """`run_s` per processed scan, milliseconds."""
        return 1e3 * self.run_s / len(self.stamps)

    @property
    def warnings(self) -> tuple[str, ...]:
        """One line each."""
        flags = np.asarray(self.infos.flags)
        few = int(np.count_nonzero(flags & Flag.FEW_VALID_BEAMS.value))
        broken = int(np.count_nonzero(flags & Flag.NONFINITE_POSE.value))
        lines = []
        if few:
            lines.append(f"{few} of {len(flags)} scans had too few returns: odometry alone moved")
        if broken:
            lines.append(f"in {broken} of {len(flags)} steps the odometry was not a number and moved nothing")
        if self.kidnapped_events:
            lines.append(
                f"the particles settled elsewhere {self.kidnapped_events} times: either the robot was "
                "carried off, or one of the places was wrong, as in a map that looks alike in many places"
            )
        if not self.converged:
            lines.append("the particles do not agree at the end: the trajectory is not to be trusted")
        return tuple(lines)


def settled_elsewhere(
    estimates: Float64[np.ndarray, "M 3"], odometry: Float64[np.ndarray, "M 3"]
) -> Int[np.ndarray, "_"]:
    """Which estimates (index into them) lie far from where odometry carries the one before.

    Args:
        estimates: `[M, 3]` (m, m, rad, world frame).
        odometry: `[M, 3]` at the same times, in its own frame.
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
        on_chunk: called with the particles every few scans.

    Raises:
        ValueError: the start is not on the map, or not in its free space.
    """
    # This index is not one of the steps, which count from 0.
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
    weights: Float32[np.ndarray, "n"] = np.exp(np.asarray(state.log_weights)[:count])
    return np.asarray(state.poses, float)[:count], weights.astype(float)
