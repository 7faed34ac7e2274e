"""Localising a log in a map, and what that leaves."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int, PRNGKeyArray

from jaxslam.core import se2
from jaxslam.core.flags import Flag
from jaxslam.localization import AMCL, AMCLInfo, AMCLState
from jaxslam.pipeline.chunks import CHUNK, advance
from jaxslam.pipeline.inputs import PreparedInputs

_MOVED, _TURNED = 1.0, np.pi / 6
"""An estimate that jumps so far, metres or radians, past what the odometry says has settled elsewhere."""

_CLOUD_EVERY = 3
"""Scans between two clouds: particles move faster than a map grows."""


@dataclass(frozen=True)
class Cloud:
    """The particles during a localisation, for those who watch.

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
    """What a localisation leaves behind.

    Attributes:
        stamps: `[T]` seconds, processed scans.
        estimates: `[T, 3]` the heaviest cluster at them (m, m, rad, world frame).
        covariances: `[T, 3, 3]` its covariance (m², m·rad, rad²).
        all_stamps: `[S]` seconds, every scan.
        all_poses: `[S, 3]` pose at every scan: the last processed one's, carried on by odometry. No later
            scan is looked at: it is what a robot would have known there and then.
        particles: `[n, 3]` those that live at the end.
        weights: `[n]` of them, normalised.
        infos: what every step left behind, NumPy arrays `[T, ...]`.
        odometry: `[T, 3]` odometry pose at the processed scans.
        compile_s: seconds spent compiling; next to none if a run of the same sizes has been before.
        run_s: seconds spent running, compilation apart.
    """

    stamps: Float64[np.ndarray, "T"]
    estimates: Float64[np.ndarray, "T 3"]
    covariances: Float64[np.ndarray, "T 3 3"]
    all_stamps: Float64[np.ndarray, "S"]
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
    key: PRNGKeyArray,
    state: AMCLState,
    prepared: PreparedInputs,
    *,
    progress: bool = False,
    on_chunk: Callable[[Cloud], None] | None = None,
) -> LocalizationResult:
    """Runs the filter over a prepared log on the host: same result as `jaxslam.localization.run`.

    Args:
        amcl: the filter.
        key: PRNG key; same key, same bytes.
        state: from `start_at`, `AMCL.init` or `AMCL.init_global`; it is consumed.
        prepared: from `prepare_inputs`.
        progress: show a progress bar on stderr (needs tqdm).
        on_chunk: called with the state of affairs every few scans.
    """

    def look(state: AMCLState, infos: list[AMCLInfo]) -> None:
        if on_chunk is not None:
            estimates = np.concatenate([info.estimate.mean for info in infos]).astype(float)
            stamp = float(prepared.stamps[len(estimates) - 1])
            on_chunk(Cloud(estimates, *_living(state), stamp))

    advanced = advance(
        amcl,
        key,
        state,
        prepared.inputs,
        tuned=False,
        progress="localising" if progress else None,
        look=look,
        every=CHUNK if on_chunk is None else _CLOUD_EVERY,
    )
    estimates = advanced.infos.estimate.mean.astype(float)
    last = np.searchsorted(prepared.scan_index, prepared.all_index, side="right") - 1
    odometry = prepared.all_odometry[np.searchsorted(prepared.all_index, prepared.scan_index)]
    since = se2.relative(odometry[last], prepared.all_odometry)
    particles, weights = _living(advanced.state)
    return LocalizationResult(
        stamps=prepared.stamps,
        estimates=estimates,
        covariances=advanced.infos.estimate.covariance.astype(float),
        all_stamps=prepared.all_stamps,
        all_poses=se2.compose(estimates[last], since),
        particles=particles,
        weights=weights,
        infos=advanced.infos,
        odometry=odometry,
        compile_s=advanced.compile_s,
        run_s=advanced.run_s,
    )


def _living(state: AMCLState) -> tuple[Float64[np.ndarray, "n 3"], Float64[np.ndarray, "n"]]:
    count = int(state.num_live)
    weights: Float32[np.ndarray, "n"] = np.exp(np.asarray(state.log_weights)[:count])
    return np.asarray(state.poses, float)[:count], weights.astype(float)
