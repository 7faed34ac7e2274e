"""The relation metric of the SLAM benchmark: local accuracy against known relative poses.

In a global comparison, one early heading error affects the whole rest of the path. Relations between poses
avoid this.

References:
    Kümmerle et al., On measuring the accuracy of SLAM algorithms, Autonomous Robots 27, 2009.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64

from jaxslam.core import se2
from jaxslam.core.trajectory import STAMP_TOLERANCE, dead_reckon
from jaxslam.metrics.alignment import check_poses, check_stamps, format_span


@dataclass(frozen=True)
class RelationError:
    """Statistics of the relation errors; always quote `n` with them.

    The benchmark's tables print mean ± std of the absolute errors and of the squared ones.

    Attributes:
        n: relations used.
        n_unused: relations outside the time that the trajectory and the odometry cover.
        trans_mean_m, trans_std_m, trans_max_m: mean, std (ddof 0), maximum of the translational errors,
            meters.
        rot_mean_deg, rot_std_deg, rot_max_deg: the same of the absolute rotational errors, degrees.
        trans_squared_mean_m2: mean squared translational error, m².
        rot_squared_mean_deg2: mean squared rotational error, deg².
    """

    n: int
    n_unused: int
    trans_mean_m: float
    trans_std_m: float
    trans_max_m: float
    rot_mean_deg: float
    rot_std_deg: float
    rot_max_deg: float
    trans_squared_mean_m2: float
    rot_squared_mean_deg2: float


def relation_errors(
    stamps: Float[np.ndarray, "_"],
    poses: Float[np.ndarray, "_ 3"],
    odometry_stamps: Float[np.ndarray, "_"],
    odometry_poses: Float[np.ndarray, "_ 3"],
    stamps_from: Float[np.ndarray, "_"],
    stamps_to: Float[np.ndarray, "_"],
    deltas: Float[np.ndarray, "_ 3"],
) -> RelationError:
    """Return statistics of the errors (x_j ⊖ x_i) ⊖ δ_ij over all relations that the trajectory covers.

    A relation's stamps may lie between two poses. The pose at a stamp is the last pose at or before the
    stamp, moved by the odometry between the two. The odometry is interpolated at both times.

    Args:
        stamps: `[M]` seconds, not decreasing: times of the SLAM poses.
        poses: `[M, 3]` SLAM poses in the world frame (m, m, rad).
        odometry_stamps: `[K]` seconds, not decreasing.
        odometry_poses: `[K, 3]` integrated odometry in its own frame (m, m, rad).
        stamps_from: `[R]` seconds, times of poses i.
        stamps_to: `[R]` seconds, times of poses j.
        deltas: `[R, 3]` true pose of j in the frame of i (m, m, rad).

    Raises:
        ValueError: on unequal lengths, empty tracks, values that are not finite, stamps that run
            backwards, or when the trajectory covers no relation at all.

    Example:
        Poses (0, 0, 0) and (1.1, 0, 0), relation (1, 0, 0): 0.1 m in translation, 0 in rotation.
    """
    translation, rotation = relation_residuals(
        stamps, poses, odometry_stamps, odometry_poses, stamps_from, stamps_to, deltas
    )
    used = np.isfinite(translation)
    if not used.any():
        raise ValueError(
            f"none of the {len(used)} relations ({format_span(stamps_from, stamps_to)}) lies within the "
            f"trajectory ({format_span(stamps)}) and the odometry ({format_span(odometry_stamps)}): "
            "check that they belong to the same log and clock"
        )
    meters, degrees = translation[used], np.rad2deg(rotation[used])
    return RelationError(
        n=int(used.sum()),
        n_unused=int((~used).sum()),
        trans_mean_m=float(meters.mean()),
        trans_std_m=float(meters.std()),
        trans_max_m=float(meters.max()),
        rot_mean_deg=float(degrees.mean()),
        rot_std_deg=float(degrees.std()),
        rot_max_deg=float(degrees.max()),
        trans_squared_mean_m2=float(np.mean(meters**2)),
        rot_squared_mean_deg2=float(np.mean(degrees**2)),
    )


def relation_residuals(
    stamps: Float[np.ndarray, "_"],
    poses: Float[np.ndarray, "_ 3"],
    odometry_stamps: Float[np.ndarray, "_"],
    odometry_poses: Float[np.ndarray, "_ 3"],
    stamps_from: Float[np.ndarray, "_"],
    stamps_to: Float[np.ndarray, "_"],
    deltas: Float[np.ndarray, "_ 3"],
) -> tuple[Float64[np.ndarray, "_"], Float64[np.ndarray, "_"]]:
    """Return the error of every relation, to find outliers. Arguments as in `relation_errors`.

    Returns:
        `[R]` translational errors in meters and `[R]` absolute rotational errors in radians, NaN
        where a relation is not used.

    Raises:
        ValueError: as in `relation_errors`, but no error is raised if no relation is covered.
    """
    check_stamps(stamps, "trajectory")
    check_poses(poses, "trajectory", len(stamps))
    check_stamps(odometry_stamps, "odometry")
    check_poses(odometry_poses, "odometry", len(odometry_stamps))
    if not len(stamps_from) == len(stamps_to) == len(deltas):
        counts = f"{len(stamps_from)} from-stamps, {len(stamps_to)} to-stamps and {len(deltas)} deltas"
        raise ValueError(f"{counts}: give one of each per relation")
    finite = np.isfinite(stamps_from) & np.isfinite(stamps_to) & np.isfinite(deltas).all(axis=1)
    if not finite.all():
        index = np.argmin(finite)
        raise ValueError(f"relation {index} is not finite ({deltas[index]}): drop it")
    track = (stamps.astype(float), poses.astype(float))
    odometry = (odometry_stamps.astype(float), odometry_poses.astype(float))
    times_from, times_to = stamps_from.astype(float), stamps_to.astype(float)
    pose_from, pose_to = (dead_reckon(times, *track, *odometry) for times in (times_from, times_to))
    error = se2.relative(deltas.astype(float), se2.relative(pose_from, pose_to))
    used = _covered(times_from, track[0], odometry[0]) & _covered(times_to, track[0], odometry[0])
    translation = np.where(used, np.linalg.norm(error[:, :2], axis=1), np.nan)
    return translation, np.where(used, np.abs(error[:, 2]), np.nan)


def _covered(
    times: Float64[np.ndarray, "Q"],
    stamps: Float64[np.ndarray, "M"],
    odometry_stamps: Float64[np.ndarray, "K"],
) -> Bool[np.ndarray, "Q"]:
    """Return which times up to the last pose have a pose, or an earlier pose and odometry since then."""
    last = np.searchsorted(stamps, times + STAMP_TOLERANCE, side="right") - 1
    inside = (last >= 0) & (times <= stamps[-1] + STAMP_TOLERANCE)
    since = stamps[np.maximum(last, 0)]
    exact = np.abs(times - since) <= STAMP_TOLERANCE
    started, ended = odometry_stamps[0] - STAMP_TOLERANCE, odometry_stamps[-1] + STAMP_TOLERANCE
    return inside & (exact | (since >= started) & (times <= ended))
