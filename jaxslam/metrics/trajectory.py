"""Absolute and relative trajectory error of stamped planar poses (ATE and RPE)."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from jaxslam.core import se2
from jaxslam.core.trajectory import Alignment
from jaxslam.metrics.alignment import align_se2, associate, check_poses

Unit = Literal["frames", "meters", "seconds"]


@dataclass(frozen=True)
class TrajectoryError:
    """Error statistics of one trajectory.

    Attributes:
        rmse_m, mean_m, std_m, max_m: statistics of the position errors, meters (std with ddof 0).
        rot_rmse_deg: root mean square of the heading errors, degrees.
        n: matched poses (ATE) or pose pairs (RPE).
    """

    rmse_m: float
    mean_m: float
    std_m: float
    max_m: float
    rot_rmse_deg: float
    n: int


@dataclass(frozen=True)
class PoseErrors:
    """Error of every matched pose, for curves over time.

    Attributes:
        stamps: `[n]` reference stamps, seconds.
        position_m: `[n]` distance to the reference, meters.
        heading_rad: `[n]` heading minus the reference's, radians in [−π, π).
    """

    stamps: Float[np.ndarray, "n"]
    position_m: Float[np.ndarray, "n"]
    heading_rad: Float[np.ndarray, "n"]


def pose_errors(
    stamps_reference: Float[np.ndarray, "_"],
    poses_reference: Float[np.ndarray, "_ 3"],
    stamps_estimate: Float[np.ndarray, "_"],
    poses_estimate: Float[np.ndarray, "_ 3"],
    *,
    align: Alignment = "se2",
    max_difference: float = 0.01,
) -> PoseErrors:
    """Return the error of each matched pose after alignment. Arguments as in `absolute_trajectory_error`."""
    stamps, reference, estimate = _matched(
        stamps_reference, poses_reference, stamps_estimate, poses_estimate, max_difference
    )
    if align is not False:
        estimate = se2.compose(estimate_frame(reference, estimate, align)[None], estimate)
    return PoseErrors(
        stamps=stamps,
        position_m=np.linalg.norm(estimate[:, :2] - reference[:, :2], axis=1),
        heading_rad=se2.wrap(estimate[:, 2] - reference[:, 2]),
    )


def estimate_frame(
    reference: Float[np.ndarray, "n 3"], estimate: Float[np.ndarray, "n 3"], align: Alignment
) -> Float[np.ndarray, "3"]:
    """Return the pose `[3]` of the estimate's frame in the reference's, from matched poses `[n, 3]`."""
    if align == "se2":
        return align_se2(reference, estimate)
    if align == "first_pose":
        return se2.compose(reference[0], se2.inverse(estimate[0]))
    raise ValueError(f"align is {align!r}: give 'se2', 'first_pose' or False")


def absolute_trajectory_error(
    stamps_reference: Float[np.ndarray, "_"],
    poses_reference: Float[np.ndarray, "_ 3"],
    stamps_estimate: Float[np.ndarray, "_"],
    poses_estimate: Float[np.ndarray, "_ 3"],
    *,
    align: Alignment = "se2",
    max_difference: float = 0.01,
) -> TrajectoryError:
    """Return the absolute trajectory error: distance to the reference at matched stamps, after alignment.

    Args:
        stamps_reference: `[R]` seconds, not decreasing.
        poses_reference: `[R, 3]` (m, m, rad).
        stamps_estimate: `[M]` seconds on the same clock, not decreasing.
        poses_estimate: `[M, 3]` (m, m, rad), in any frame unless `align` is False.
        align: "se2" moves the whole estimate for the least squared position error; "first_pose"
            moves its first matched pose to the reference's; False compares without alignment.
        max_difference: largest difference of matched stamps, seconds.

    Raises:
        ValueError: on unequal lengths, values that are not finite, stamps that run backwards or do
            not overlap, or an alignment that the data do not determine.

    References:
        Sturm et al., A benchmark for the evaluation of RGB-D SLAM systems, IROS 2012.
    """
    errors = pose_errors(
        stamps_reference,
        poses_reference,
        stamps_estimate,
        poses_estimate,
        align=align,
        max_difference=max_difference,
    )
    return _statistics(errors.position_m, errors.heading_rad)


def relative_pose_error(
    stamps_reference: Float[np.ndarray, "_"],
    poses_reference: Float[np.ndarray, "_ 3"],
    stamps_estimate: Float[np.ndarray, "_"],
    poses_estimate: Float[np.ndarray, "_ 3"],
    *,
    delta: float,
    unit: Unit = "frames",
    all_pairs: bool = True,
    max_difference: float = 0.01,
) -> TrajectoryError:
    """Return the relative pose error: drift over a fixed number of frames, path length or time.

    The error of the pair (i, j) is the difference of the two relative motions,
    (r_j ⊖ r_i)⁻¹ ⊕ (e_j ⊖ e_i): its translation and rotation. No alignment is needed. `j` is the
    first pose that is `delta` or more after `i`, path and time measured along the reference.

    Args:
        stamps_reference: `[R]` seconds, not decreasing.
        poses_reference: `[R, 3]` (m, m, rad).
        stamps_estimate: `[M]` seconds on the same clock, not decreasing.
        poses_estimate: `[M, 3]` (m, m, rad), in any frame.
        delta: length of a pair, in `unit`.
        unit: "frames" (matched poses), "meters" or "seconds".
        all_pairs: start a pair at every pose (they overlap); otherwise each pair starts where the
            last ended, as evo does by default.
        max_difference: largest difference of matched stamps, seconds.

    Raises:
        ValueError: as `absolute_trajectory_error`, or if `delta` is not positive, not a whole
            number of frames, or longer than the trajectory.

    References:
        Sturm et al., A benchmark for the evaluation of RGB-D SLAM systems, IROS 2012.
    """
    stamps, reference, estimate = _matched(
        stamps_reference, poses_reference, stamps_estimate, poses_estimate, max_difference
    )
    start, end = _pairs(stamps, reference, delta, unit, all_pairs)
    motion_reference = se2.relative(reference[start], reference[end])
    motion_estimate = se2.relative(estimate[start], estimate[end])
    error = se2.relative(motion_reference, motion_estimate)
    return _statistics(np.linalg.norm(error[:, :2], axis=1), error[:, 2])


def _pairs(
    stamps: Float[np.ndarray, "n"], poses: Float[np.ndarray, "n 3"], delta: float, unit: Unit, all_pairs: bool
) -> tuple[Int[np.ndarray, "k"], Int[np.ndarray, "k"]]:
    """Return the first and last index of every pair that spans `delta`."""
    if not (np.isfinite(delta) and delta > 0):
        raise ValueError(f"delta is {delta}: give a positive number of {unit}")
    if unit == "frames":
        if delta != round(delta):
            raise ValueError(f"delta is {delta} frames: give a whole number")
        progress = np.arange(len(stamps), dtype=float)
    elif unit == "meters":
        steps = np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1)
        progress = np.append(0.0, np.cumsum(steps))
    elif unit == "seconds":
        progress = stamps - stamps[0]
    else:
        raise ValueError(f"unit is {unit!r}: give 'frames', 'meters' or 'seconds'")
    # With the slack, ten steps of 0.1 m or s reach 1 in spite of rounding.
    end = np.searchsorted(progress, progress + delta - 1e-6, side="left")
    start = np.flatnonzero(end < len(progress))
    if len(start) == 0:
        span = f"the matched trajectory spans only {progress[-1]:.3f}"
        raise ValueError(f"delta is {delta} {unit} but {span}: give a smaller delta")
    if not all_pairs:
        chain = [0]
        while end[chain[-1]] < len(end):
            chain.append(end[chain[-1]])
        start = np.array(chain[:-1])
    return start, end[start]


def _matched(
    stamps_reference: Float[np.ndarray, "_"],
    poses_reference: Float[np.ndarray, "_ 3"],
    stamps_estimate: Float[np.ndarray, "_"],
    poses_estimate: Float[np.ndarray, "_ 3"],
    max_difference: float,
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Return matched reference stamps, reference poses and estimated poses, float64."""
    check_poses(poses_reference, "reference", len(stamps_reference))
    check_poses(poses_estimate, "estimate", len(stamps_estimate))
    index_reference, index_estimate = associate(stamps_reference, stamps_estimate, max_difference)
    return (
        stamps_reference[index_reference].astype(float),
        poses_reference[index_reference].astype(float),
        poses_estimate[index_estimate].astype(float),
    )


def _statistics(position: Float[np.ndarray, "n"], heading: Float[np.ndarray, "n"]) -> TrajectoryError:
    return TrajectoryError(
        rmse_m=float(np.sqrt(np.mean(position**2))),
        mean_m=float(position.mean()),
        std_m=float(position.std()),
        max_m=float(position.max()),
        rot_rmse_deg=float(np.rad2deg(np.sqrt(np.mean(heading**2)))),
        n=len(position),
    )
