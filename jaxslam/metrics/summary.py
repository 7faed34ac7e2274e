"""Errors of a run against relations or a reference, as written to `metrics.json`."""

from dataclasses import asdict
from typing import Any

import numpy as np
from jaxtyping import Float64

from jaxslam.core import se2
from jaxslam.core.trajectory import STAMP_TOLERANCE, Alignment, dead_reckon
from jaxslam.io.relations import Relations
from jaxslam.metrics import TrajectoryError, absolute_trajectory_error, relation_errors
from jaxslam.metrics.alignment import format_span
from jaxslam.metrics.trajectory import estimate_frame
from jaxslam.pipeline.inputs import PreparedScans

_RELATION_KEYS = ("n", "trans_mean_m", "trans_std_m", "trans_max_m", "rot_mean_deg", "rot_std_deg")
_TRAJECTORY_KEYS = ("rmse_m", "max_m", "rot_rmse_deg", "n")


def relation_figures(
    relations: Relations, scans: PreparedScans, poses: Float64[np.ndarray, "S 3"]
) -> dict[str, float]:
    """Return statistics of the relation errors of the poses at all scans, see `relation_errors`."""
    known = relations.stamps_from, relations.stamps_to, relations.deltas
    odometry = scans.odometry
    error = relation_errors(scans.all_stamps, poses, odometry.stamps, odometry.poses, *known)
    return {key: asdict(error)[key] for key in _RELATION_KEYS}


def reference_error(
    truth: Any,
    scans: PreparedScans,
    poses: Float64[np.ndarray, "S 3"],
    *,
    align: Alignment = "se2",
    since: float = -np.inf,
) -> TrajectoryError:
    """Return the absolute trajectory error, with every reference pose compared at its own time.

    Odometry extends the estimate, `poses` `[S, 3]` at all scans, between the scans. Only the estimate from
    `since` (s) on counts. `truth` and `align` are those of `RunResult.error`, which has the same errors.
    """
    times, reference, estimate = _at_reference_times(truth, scans, poses, since)
    return absolute_trajectory_error(times, reference, times, estimate, align=align)


def reference_frame(
    truth: Any, scans: PreparedScans, poses: Float64[np.ndarray, "S 3"], align: Alignment
) -> Float64[np.ndarray, "3"]:
    """Return the pose `[3]` of the reference's frame in the estimate's, as `reference_error` aligns them."""
    if align is False:
        return np.zeros(3)
    _, reference, estimate = _at_reference_times(truth, scans, poses)
    return estimate_frame(estimate, reference, align)


def reference_path(
    truth: Any, scans: PreparedScans, poses: Float64[np.ndarray, "S 3"], align: Alignment = "se2"
) -> Float64[np.ndarray, "n 3"]:
    """Return the reference's poses `[n, 3]` within the estimate, moved to the estimate's frame."""
    _, reference, _ = _at_reference_times(truth, scans, poses)
    return se2.compose(reference_frame(truth, scans, poses, align)[None], reference)


def _at_reference_times(
    truth: Any, scans: PreparedScans, poses: Float64[np.ndarray, "S 3"], since: float = -np.inf
) -> tuple[Float64[np.ndarray, "n"], Float64[np.ndarray, "n 3"], Float64[np.ndarray, "n 3"]]:
    """Return the times of the reference within the estimate, and reference and estimate at these times.

    Using the scan nearest in time instead would count the robot's motion in between as an error.
    """
    kept = scans.all_stamps >= since
    stamps, poses, times = scans.all_stamps[kept], poses[kept], truth.stamps
    within = (stamps[0] - STAMP_TOLERANCE <= times) & (times <= stamps[-1] + STAMP_TOLERANCE)
    count = np.count_nonzero(within)
    if count < 2:
        raise ValueError(
            f"{count} of the {len(within)} reference poses ({format_span(times)}) lie within the "
            f"trajectory ({format_span(stamps)}): check that they belong to the same log and clock"
        )
    times = times[within]
    estimate = dead_reckon(times, stamps, poses, scans.odometry.stamps, scans.odometry.poses)
    return times, truth.poses[within], estimate


def trajectory_figures(error: TrajectoryError) -> dict[str, float]:
    """Return the entries of `ate` in `metrics.json`."""
    return {key: asdict(error)[key] for key in _TRAJECTORY_KEYS}
