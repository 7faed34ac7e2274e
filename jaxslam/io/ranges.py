"""Cleaning of range readings: detection of "no return", and of a maximum range missing from the log."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Float32, Float64, Int64

# Status codes of SICK LMS scanners (dazzled, overflow, no echo): the largest integers of 13, 14 and
# 15 bits. The unit is 1 mm or 1 cm, depending on the configuration.
SICK_CODES = tuple((2**bits - 9, 2**bits - 1) for bits in (13, 14, 15))

# A saturated reading must appear twice or more in at least this many scans.
SATURATED_SCANS = 3


def clean_ranges(
    ranges: Float[np.ndarray, "T B"],
    range_min: float | Float64[np.ndarray, "T 1"],
    range_max: float | Float64[np.ndarray, "T 1"],
) -> Float32[np.ndarray, "T B"]:
    """Return readings `[T, B]` in meters, with NaN in place of every reading that is not a return.

    A return lies in (0, ∞), at or above `range_min` and below `range_max`.
    """
    with np.errstate(invalid="ignore"):
        usable = (ranges > 0) & (ranges >= range_min) & (ranges < range_max)
    return np.where(usable, ranges, np.nan).astype(np.float32)


def pad_ranges(
    scans: Sequence[Float[np.ndarray, "_"]],
) -> tuple[Float64[np.ndarray, "T B"], Int64[np.ndarray, "T"]]:
    """Return the readings of all scans, padded with NaN at the end, and the number of beams of each."""
    num_beams = np.array([len(readings) for readings in scans], dtype=np.int64)
    ranges = np.full((len(scans), int(num_beams.max())), np.nan)
    for row, readings in zip(ranges, scans, strict=True):
        row[: len(readings)] = readings
    return ranges, num_beams


def saturated_reading(ranges: Float64[np.ndarray, "T B"]) -> float | None:
    """Return the reading, in meters, from which a sensor of unknown maximum range reports no return.

    There are two criteria, in this order. If the largest reading is a status code of the SICK LMS (8.183 to
    8.191 m, 81.83 to 81.91 m, and the same for 14 and 15 bits), the result is the smallest code of that
    interval. If the largest reading is saturated, the result is that reading. It is saturated if it appears
    several times per scan in three scans or more, and more often than all readings in the 10 % below it; the
    farthest wall would also cause readings just below the largest.

    Args:
        ranges: `[T, B]` readings as recorded, NaN for no beam.

    Returns:
        The smallest reading that means "no return", or None if neither criterion is met.
    """
    finite = np.isfinite(ranges) & (ranges > 0)
    if not finite.any():
        return None
    largest = float(ranges[finite].max())
    for low, high in SICK_CODES:
        for unit in (1e-3, 1e-2):
            # Half a unit of slack: 81.83 is not exactly 8183 hundredths in binary.
            if (low - 0.5) * unit <= largest <= (high + 0.5) * unit:
                return (low - 0.5) * unit
    at_largest = ranges == largest
    just_below = (ranges >= 0.9 * largest) & (ranges < largest)
    has_others = bool((ranges[finite] < 0.9 * largest).any())
    fills_scans = np.count_nonzero(at_largest.sum(axis=1) >= 2) >= SATURATED_SCANS
    stands_out = np.count_nonzero(at_largest) > np.count_nonzero(just_below)
    return largest if has_others and fills_scans and stands_out else None
