"""Alignment of two trajectories: in time by their stamps, in space by a rigid motion."""

import numpy as np
from jaxtyping import Float, Int

from jaxslam.core import se2


def associate(
    stamps_reference: Float[np.ndarray, "R"], stamps_estimate: Float[np.ndarray, "M"], max_difference: float
) -> tuple[Int[np.ndarray, "n"], Int[np.ndarray, "n"]]:
    """Match stamps one to one: each stamp of a pair is the nearest one to the other.

    Args:
        stamps_reference: `[R]` seconds, not decreasing.
        stamps_estimate: `[M]` seconds, not decreasing.
        max_difference: largest difference of a pair, seconds.

    Returns:
        Indices `[n]` into the reference and `[n]` into the estimate.

    Raises:
        ValueError: if a stamp is not finite or runs backwards, `max_difference` < 0, or nothing matches.

    Example:
        `associate([0, 1, 2], [0.9, 1.2, 2.1], 0.5)` is `([1, 2], [0, 2])`.
    """
    check_stamps(stamps_reference, "reference")
    check_stamps(stamps_estimate, "estimate")
    if not max_difference >= 0:
        raise ValueError(f"max_difference is {max_difference}: give a number of seconds >= 0")
    to_estimate = _nearest(stamps_estimate, stamps_reference)
    to_reference = _nearest(stamps_reference, stamps_estimate)
    index = np.arange(len(stamps_reference))
    difference = np.abs(stamps_estimate[to_estimate] - stamps_reference)
    matched = (to_reference[to_estimate] == index) & (difference <= max_difference)
    if not matched.any():
        raise ValueError(
            f"no stamps match within {max_difference} s: the reference covers "
            f"{format_span(stamps_reference)}, the estimate {format_span(stamps_estimate)}; "
            "check the clocks or raise max_difference"
        )
    return index[matched], to_estimate[matched]


def align_se2(
    reference: Float[np.ndarray, "_ 3"], estimate: Float[np.ndarray, "_ 3"]
) -> Float[np.ndarray, "3"]:
    """Return the rigid motion that minimizes the squared distances of an estimate to its reference.

    Only positions are used.

    Args:
        reference: `[n, 3]` poses (m, m, rad).
        estimate: `[n, 3]` poses matched to the reference poses, in the frame of the estimate.

    Returns:
        `[3]` pose of the estimate's frame in the reference's; `se2.compose(result, estimate)` aligns it.

    Raises:
        ValueError: if lengths differ, a value is not finite, there are fewer than two poses, or the
            positions do not determine a rotation (the robot never moved).

    References:
        Umeyama, Least-squares estimation of transformation parameters between two point patterns,
        PAMI 1991, eq. 40 and 41 with scale 1.
    """
    check_poses(reference, "reference", len(reference))
    check_poses(estimate, "estimate", len(reference))
    if len(reference) < 2:
        count = f"{len(reference)} matched pose cannot determine a rotation"
        raise ValueError(f"{count}: give two or more, or align by 'first_pose'")
    points_reference = reference[:, :2].astype(float)
    points_estimate = estimate[:, :2].astype(float)
    mean_reference, mean_estimate = points_reference.mean(axis=0), points_estimate.mean(axis=0)
    p, q = points_estimate - mean_estimate, points_reference - mean_reference
    # The sums are proportional to the cosine and the sine of the rotation.
    cosine = np.sum(p * q)
    sine = np.sum(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0])
    # Rounding of the coordinates alone can cause sums of this size.
    rounding = 64 * np.finfo(float).eps * len(p)
    rounding *= np.abs(points_estimate).max() * np.abs(points_reference).max()
    if np.hypot(cosine, sine) <= rounding:
        raise ValueError(
            f"the {len(p)} matched positions do not determine a rotation (the robot stands still "
            "in one of the trajectories): align by 'first_pose'"
        )
    rotation = se2.wrap(np.array([0.0, 0.0, np.arctan2(sine, cosine)]))
    turned_mean = se2.compose(rotation, np.append(mean_estimate, 0.0))
    return np.append(mean_reference - turned_mean[:2], rotation[2])


def _nearest(sorted_values: Float[np.ndarray, "a"], queries: Float[np.ndarray, "b"]) -> Int[np.ndarray, "b"]:
    """Return the index of the value nearest to each query; the earlier one of a tie."""
    right = np.clip(np.searchsorted(sorted_values, queries), 0, len(sorted_values) - 1)
    left = np.maximum(right - 1, 0)
    nearer_left = np.abs(queries - sorted_values[left]) <= np.abs(sorted_values[right] - queries)
    return np.where(nearer_left, left, right)


def format_span(*stamps: Float[np.ndarray, "_"]) -> str:
    """Return the time that the stamps cover, for messages."""
    values = np.concatenate(stamps)
    return f"{values.min():.3f} to {values.max():.3f} s" if values.size else "empty"


def check_stamps(stamps: Float[np.ndarray, "_"], name: str) -> None:
    """Raise an error if stamps are empty, not finite or decreasing; `name` is the name of the track."""
    if len(stamps) == 0:
        raise ValueError(f"the {name} has no poses: give a trajectory with at least one")
    if not np.isfinite(stamps).all():
        index = int(np.flatnonzero(~np.isfinite(stamps))[0])
        raise ValueError(f"{name} stamp {index} is {stamps[index]}: drop poses without a time")
    if (backwards := np.flatnonzero(np.diff(stamps) < 0)).size:
        index = int(backwards[0])
        steps = f"{stamps[index]} then {stamps[index + 1]}"
        raise ValueError(f"{name} stamps run backwards at {index}: {steps}; sort the trajectory by time")


def check_poses(poses: Float[np.ndarray, "_ 3"], name: str, length: int) -> None:
    """Raise an error unless there are `length` finite poses; `name` is the name of the track."""
    if len(poses) != length:
        raise ValueError(f"the {name} has {len(poses)} poses but should have {length}: give as many")
    if not np.isfinite(poses).all():
        index = int(np.flatnonzero(~np.isfinite(poses).all(axis=1))[0])
        raise ValueError(f"{name} pose {index} is {poses[index]}: drop poses that are not finite")
