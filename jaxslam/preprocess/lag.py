"""Time lag between a log's scans and its odometry, estimated from the rotation in both."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int

from jaxslam.core import se2
from jaxslam.core.trajectory import interpolate_poses
from jaxslam.io.log import OdometryTrack, ScanTrack

_MAX_TURN = 0.4
"""Largest rotation between two scans that is searched, radians."""
_MAX_BEAMS = 360
"""Most beams to compare; more are thinned."""
_MIN_BEAMS = 10
"""Fewest beams that show a rotation."""
_MAX_PAIRS = 800
"""Most pairs of scans to compare; more are thinned."""
_MIN_PAIRS = 30
"""Fewest pairs with rotation that are enough for an estimate."""
_MIN_RATE = 0.1
"""Smallest turning rate of a pair, rad/s."""
_INTERVALS = (0.02, 0.5)
"""Shortest and longest time between the scans of a pair, seconds: longer intervals average the rates."""
_FAR = 5.0
"""Ranges are clipped here, meters: far points hardly change when the robot moves."""
_STEP = 0.02
"""Step between tested lags, seconds."""
_MIN_CORRELATION = 0.75
_MIN_DROP = 0.03
"""Smallest drop of the correlation from its peak to `_DROP_AT` on either side."""
_DROP_AT = 0.2
"""Seconds."""


@dataclass(frozen=True)
class ScanLag:
    """The time of the scans on the odometry's clock.

    Attributes:
        seconds: time from a scan's stamp to the middle of its sweep; negative if the stamp is late.
        correlation: correlation of both turning rates at this lag, up to 1.
    """

    seconds: float
    correlation: float


def estimate_lag(scans: ScanTrack, odometry: OdometryTrack, max_lag: float) -> ScanLag | None:
    """Estimate the lag at which the rotation seen in the scans agrees best with that of the odometry.

    Each scan is rotated to match the previous one; the resulting turning rates are correlated with those of
    the odometry at every lag.

    Args:
        scans: scans with NaN for no return.
        odometry: odometry over the same time.
        max_lag: largest lag to test in either direction, seconds.

    Returns:
        The lag. None if the robot turns too little, the scans are too far apart, or the correlation has no
        clear peak.
    """
    pairs = _turning_pairs(scans, odometry, max_lag)
    if len(pairs) < _MIN_PAIRS or scans.ranges.shape[1] < _MIN_BEAMS:
        return None
    turned = _rotations(scans, pairs)
    intervals = scans.stamps[pairs + 1] - scans.stamps[pairs]
    seen = np.abs(turned) < 0.95 * _MAX_TURN
    if np.count_nonzero(seen) < _MIN_PAIRS:
        return None
    pairs, rates = pairs[seen], (turned / intervals)[seen]
    reach = int(np.ceil((max_lag + _DROP_AT) / _STEP))
    lags = np.arange(-reach, reach + 1) * _STEP
    correlations = np.array([_correlation(rates, _rates(scans, odometry, pairs, lag)) for lag in lags])
    peak = int(np.argmax(np.where(np.abs(lags) <= max_lag + 1e-9, correlations, -np.inf)))
    aside = round(_DROP_AT / _STEP)
    drop = correlations[peak] - np.max(correlations[[peak - aside, peak + aside]])
    if correlations[peak] < _MIN_CORRELATION or drop < _MIN_DROP:
        return None
    fraction = _vertex(correlations[peak - 1], correlations[peak], correlations[peak + 1])
    return ScanLag(float(lags[peak] + fraction * _STEP), float(correlations[peak]))


def _turning_pairs(scans: ScanTrack, odometry: OdometryTrack, max_lag: float) -> Int[np.ndarray, "P"]:
    """Return indices of scans soon followed by another while the robot turns, at some lag ≤ `max_lag`."""
    intervals = np.diff(scans.stamps)
    pairs = np.flatnonzero((intervals > _INTERVALS[0]) & (intervals < _INTERVALS[1]))
    if len(pairs) == 0:
        return pairs
    around = np.linspace(-max_lag, max_lag, 11)
    fastest = np.max([np.abs(_rates(scans, odometry, pairs, lag)) for lag in around], axis=0)
    pairs = pairs[fastest > _MIN_RATE]
    return pairs[:: -(-len(pairs) // _MAX_PAIRS)] if len(pairs) > _MAX_PAIRS else pairs


def _rates(
    scans: ScanTrack, odometry: OdometryTrack, pairs: Int[np.ndarray, "P"], lag: float
) -> Float64[np.ndarray, "P"]:
    """Return the odometry's turning rate over each pair, `lag` seconds later."""
    before, after = scans.stamps[pairs], scans.stamps[pairs + 1]
    first = interpolate_poses(odometry.stamps, odometry.poses, before + lag)
    second = interpolate_poses(odometry.stamps, odometry.poses, after + lag)
    return se2.wrap(second[:, 2] - first[:, 2]) / (after - before)


def _rotations(scans: ScanTrack, pairs: Int[np.ndarray, "P"]) -> Float64[np.ndarray, "P"]:
    """Return the lidar's rotation between the scans of each pair, radians, interpolated between beams."""
    stride = -(-scans.ranges.shape[1] // _MAX_BEAMS)
    with np.errstate(invalid="ignore"):
        cut = np.minimum(scans.ranges[:, ::stride].astype(np.float64), _FAR)
    # Treat no return as a far one, and compare ratios of ranges rather than differences.
    profiles = np.log(np.where(np.isfinite(cut), np.maximum(cut, 0.1), _FAR))
    num_beams = profiles.shape[1]
    step = float(np.median(scans.angle_increment)) * stride
    reach = max(min(int(np.ceil(_MAX_TURN / abs(step))), num_beams // 3), 1)
    before, after = profiles[pairs], profiles[pairs + 1]
    costs = np.empty((len(pairs), 2 * reach + 1))
    for column, shift in enumerate(range(-reach, reach + 1)):
        low, high = max(0, shift), min(num_beams, num_beams + shift)
        difference = np.abs(after[:, low - shift : high - shift] - before[:, low:high])
        costs[:, column] = np.minimum(difference, 0.3).mean(axis=1)
    best = np.clip(np.argmin(costs, axis=1), 1, 2 * reach - 1)
    rows = np.arange(len(pairs))
    fraction = _vertex(-costs[rows, best - 1], -costs[rows, best], -costs[rows, best + 1])
    first = scans.angle_min[pairs] - scans.angle_min[pairs + 1]
    return (best - reach + fraction) * step + se2.wrap(first)


def _vertex(
    before: Float64[np.ndarray, "*any"] | float,
    middle: Float64[np.ndarray, "*any"] | float,
    after: Float64[np.ndarray, "*any"] | float,
) -> Float64[np.ndarray, "*any"]:
    """Return the offset, from −½ to ½, of the peak of the parabola through three values."""
    curvature = np.asarray(before - 2 * middle + after, dtype=np.float64)
    safe = np.where(curvature < 0, curvature, -1.0)
    return np.asarray(np.clip(np.where(curvature < 0, 0.5 * (before - after) / safe, 0.0), -0.5, 0.5))


def _correlation(one: Float64[np.ndarray, "P"], other: Float64[np.ndarray, "P"]) -> float:
    return float(np.corrcoef(one, other)[0, 1]) if np.ptp(one) > 0 and np.ptp(other) > 0 else 0.0
