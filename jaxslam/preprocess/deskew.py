"""Deskewing: remove the robot's motion during a scan.

A spinning lidar needs a tenth of a second or more for a scan. A robot that turns at 1 rad/s turns by 6° in
that time. The odometry gives this motion: every end point is transformed to the lidar's pose at the scan's
stamp, and the ranges are resampled at the beam angles.
"""

import dataclasses

import numpy as np
from jaxtyping import Float32, Float64

from jaxslam.core import se2
from jaxslam.core.trajectory import interpolate_poses
from jaxslam.io.log import OdometryTrack, ScanTrack, SensorLog
from jaxslam.io.stamps import nearest_rows
from jaxslam.preprocess.lag import ScanLag, estimate_lag

_LONGEST_INTERVAL = 0.3
"""Longest interval between odometry poses over which the motion is interpolated, seconds."""
_NUM_KNOTS = 9
"""Number of lidar poses interpolated along a sweep."""
_LEAST_TRANSLATION, _LEAST_ROTATION = 0.005, 0.003
"""Scans with less motion are not changed: meters, radians."""
_LEAST_LAG = 0.06
"""Smallest lag relative to the log's own timing that is corrected, seconds. On simulated drives without lag,
the estimates are 0.02 to 0.03 s."""
_STEEPEST = np.tan(np.radians(5.0))
"""Smallest angle between beams and the line through their end points, if both lie on one wall."""


@dataclasses.dataclass(frozen=True)
class SweepTiming:
    """When the beams of a scan were taken.

    Attributes:
        middle: time from the stamp to the middle of the sweep, seconds.
        time_increment: time from one beam to the next, seconds.
        lag: the lag estimated from rotations, or None if the log's own timing is used.
    """

    middle: float
    time_increment: float
    lag: ScanLag | None


def sweep_timing(log: SensorLog, turn_time: float, max_lag: float) -> SweepTiming | None:
    """Estimate when the beams of a log's scans were taken.

    By default, the timing is the log's own time increment, counted from the stamp, as in a LaserScan. For a
    log without time increment, a constant rotation and a stamp at the end of the scan are assumed. A
    different lag estimated from rotations overrides this timing.

    Args:
        log: a log with scans and odometry.
        turn_time: duration of a full turn of the lidar, seconds; 0 if all beams are simultaneous.
        max_lag: largest lag to search for, seconds; 0 trusts the stamps.

    Returns:
        The timing. None if scans or odometry are missing or too sparse to interpolate the motion, or if the
        lidar has only one beam.
    """
    scans, odometry = log.scans, log.odometry
    if scans is None or odometry is None or len(scans.stamps) == 0 or len(odometry.stamps) < 2:
        return None
    if np.median(np.diff(odometry.stamps)) > _LONGEST_INTERVAL:
        return None
    beams = float(np.median(scans.num_beams)) - 1
    if beams < 1 or np.median(scans.angle_increment) == 0:
        return None
    if scans.time_increment is not None:
        increment = scans.time_increment
        middle = 0.5 * beams * increment
    else:
        increment = turn_time * abs(float(np.median(scans.angle_increment))) / (2 * np.pi)
        middle = -0.5 * beams * increment
    lag = estimate_lag(scans, odometry, max_lag) if max_lag > 0 else None
    if lag is not None and abs(lag.seconds - middle) < _LEAST_LAG:
        lag = None
    return SweepTiming(middle if lag is None else lag.seconds, increment, lag)


def deskew(log: SensorLog, timing: SweepTiming) -> SensorLog:
    """Return the log with every scan as seen by a lidar at rest at the scan's stamp.

    Between two end points on one wall, ranges are interpolated along the line through them. Elsewhere the
    nearest beam is used.
    """
    scans, odometry = log.scans, log.odometry
    if scans is None or odometry is None:
        return log
    num_beams = scans.ranges.shape[1]
    beams = np.linspace(0, num_beams - 1, _NUM_KNOTS)
    # The sweep has the usual number of beams; padding at the end was never measured.
    offsets = timing.middle + (beams - 0.5 * (float(np.median(scans.num_beams)) - 1)) * timing.time_increment
    reference = _lidar_poses(scans, odometry, scans.stamps)
    knots = np.stack(
        [se2.relative(reference, _lidar_poses(scans, odometry, scans.stamps + at)) for at in offsets],
        axis=1,
    )
    moved = np.max(np.hypot(knots[..., 0], knots[..., 1]), axis=1) > _LEAST_TRANSLATION
    moved |= np.max(np.abs(knots[..., 2]), axis=1) > _LEAST_ROTATION
    moved &= (scans.num_beams > 1) & (scans.angle_increment != 0)
    ranges = scans.ranges.copy()
    for row in np.flatnonzero(moved):
        path = np.stack([np.interp(np.arange(num_beams), beams, knots[row, :, i]) for i in range(3)], axis=1)
        first, step, count = scans.angle_min[row], scans.angle_increment[row], scans.num_beams[row]
        ranges[row, :count] = _seen_from_rest(scans.ranges[row, :count], path[:count], first, step)
    return dataclasses.replace(log, scans=dataclasses.replace(scans, ranges=ranges, time_increment=0.0))


def _lidar_poses(
    scans: ScanTrack, odometry: OdometryTrack, stamps: Float64[np.ndarray, "T"]
) -> Float64[np.ndarray, "T 3"]:
    return se2.compose(interpolate_poses(odometry.stamps, odometry.poses, stamps), scans.pose_base_lidar)


def _seen_from_rest(
    ranges: Float32[np.ndarray, "B"], path: Float64[np.ndarray, "B 3"], first: float, step: float
) -> Float64[np.ndarray, "B"]:
    """Return ranges `[B]` seen from the origin, given beams measured along a path.

    Args:
        ranges: `[B]` meters, NaN for no return.
        path: `[B, 3]` pose of the lidar at each beam, relative to its pose at rest.
        first: angle of beam 0, radians.
        step: angle between beams, radians.
    """
    wanted = np.arange(len(ranges))
    returned = np.isfinite(ranges)
    angles = first + step * wanted
    reach = np.where(returned, ranges.astype(np.float64), 0.0)
    x = path[:, 0] + reach * np.cos(angles + path[:, 2])
    y = path[:, 1] + reach * np.sin(angles + path[:, 2])
    distance = np.hypot(x, y)
    # A beam without return keeps its own direction, like a point very far away.
    turned = np.where(returned, np.arctan2(y, x) - angles, path[:, 2])
    place = wanted + se2.wrap(turned) / step

    whole_turn = round(2 * np.pi / abs(step))
    if len(ranges) >= whole_turn - 1:
        # A full turn: the first beams follow the last ones.
        place = np.concatenate([place - whole_turn, place, place + whole_turn])
        distance, returned = np.tile(distance, 3), np.tile(returned, 3)
    order = np.argsort(place, kind="stable")
    place, distance, returned = place[order], distance[order], returned[order]

    after = np.searchsorted(place, wanted)
    inside = (after > 0) & (after < len(place))
    after = np.clip(after, 1, len(place) - 1)
    before = after - 1
    nearer = nearest_rows(place, wanted)
    near = np.abs(place[nearer] - wanted) <= np.where(inside, 1.0, 0.5)
    found = np.where(near & returned[nearer], distance[nearer], np.nan)

    one, other = distance[before], distance[after]
    apart = (place[after] - place[before]) * abs(step)
    wall = inside & returned[before] & returned[after] & (apart < 3 * abs(step)) & (apart > 0)
    wall &= np.abs(one - other) * _STEEPEST <= apart * np.minimum(one, other)
    # Intersect the ray at the wanted angle with the line through both points.
    to_one, to_other = (wanted - place[before]) * abs(step), (place[after] - wanted) * abs(step)
    across = one * np.sin(to_one) + other * np.sin(to_other)
    on_line = one * other * np.sin(apart) / np.where(across > 0, across, 1.0)
    return np.where(wall & (across > 0), on_line, found)
