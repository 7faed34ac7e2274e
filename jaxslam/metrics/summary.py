"""Errors of a run against relations or a reference, as written to `metrics.json`."""

from dataclasses import asdict

import numpy as np
from jaxtyping import Float64

from jaxslam.core.trajectory import STAMP_TOLERANCE, dead_reckon
from jaxslam.io.log import OdometryTrack
from jaxslam.io.relations import Relations
from jaxslam.metrics import TrajectoryError, absolute_trajectory_error, relation_errors
from jaxslam.metrics.alignment import format_span
from jaxslam.metrics.trajectory import Alignment

_RELATION_KEYS = ("n", "trans_mean_m", "trans_std_m", "trans_max_m", "rot_mean_deg", "rot_std_deg")
_TRAJECTORY_KEYS = ("rmse_m", "max_m", "rot_rmse_deg", "n")


def relation_figures(
    stamps: Float64[np.ndarray, "S"],
    poses: Float64[np.ndarray, "S 3"],
    odometry: OdometryTrack,
    relations: Relations,
) -> dict[str, float]:
    """Return statistics of the relation errors of a trajectory, see `jaxslam.metrics.relation_errors`."""
    known = relations.stamps_from, relations.stamps_to, relations.deltas
    error = relation_errors(stamps, poses, odometry.stamps, odometry.poses, *known)
    return {key: asdict(error)[key] for key in _RELATION_KEYS}


def reference_error(
    reference_stamps: Float64[np.ndarray, "R"],
    reference: Float64[np.ndarray, "R 3"],
    stamps: Float64[np.ndarray, "S"],
    poses: Float64[np.ndarray, "S 3"],
    odometry: OdometryTrack,
    *,
    align: Alignment = "se2",
) -> TrajectoryError:
    """Return the absolute trajectory error, with every reference pose compared at its own time.

    Using the scan nearest in time instead would count the robot's motion in between as an error.

    Args:
        reference_stamps: `[R]` seconds, not decreasing, on the log's clock.
        reference: `[R, 3]` poses (m, m, rad), in any frame unless `align` is False.
        stamps: `[S]` seconds, times of the estimate.
        poses: `[S, 3]` the estimate.
        odometry: extends the estimate between its stamps.
        align: alignment of the estimate with the reference, as in `absolute_trajectory_error`.

    Raises:
        ValueError: fewer than two reference poses lie within the trajectory, or stamps run backwards.
    """
    first, last = stamps[0] - STAMP_TOLERANCE, stamps[-1] + STAMP_TOLERANCE
    within = (first <= reference_stamps) & (reference_stamps <= last)
    count = np.count_nonzero(within)
    if count < 2:
        raise ValueError(
            f"{count} of the {len(within)} reference poses ({format_span(reference_stamps)}) lie within the "
            f"trajectory ({format_span(stamps)}): check that they belong to the same log and clock"
        )
    times = reference_stamps[within]
    estimate = dead_reckon(times, stamps, poses, odometry.stamps, odometry.poses)
    return absolute_trajectory_error(times, reference[within], times, estimate, align=align)


def trajectory_figures(error: TrajectoryError) -> dict[str, float]:
    """Return the entries of `ate` in `metrics.json`."""
    return {key: asdict(error)[key] for key in _TRAJECTORY_KEYS}
