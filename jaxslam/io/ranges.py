"""Cleaning range readings: what is "no return", and a maximum range that a log does not name."""

import numpy as np
from jaxtyping import Float, Float32, Float64

# SICK LMS scanners send these integers at the top of their 13, 14 and 15 bit range instead of a
# distance: dazzled, overflow, no echo. The unit is 1 mm or 1 cm by configuration.
SICK_CODES = tuple((2**bits - 9, 2**bits - 1) for bits in (13, 14, 15))

# A saturated reading is believed to be one where it fills this many scans twice or more.
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


def saturated_reading(ranges: Float64[np.ndarray, "T B"]) -> float | None:
    """Return the reading, in meters, from which a sensor of unknown maximum range reports no return.

    Two signs, in this order. The largest reading is one of the SICK LMS' status codes (8.183 to
    8.191 m, 81.83 to 81.91 m, and the same for 14 and 15 bits): the smallest code of that interval
    is the answer. Or the largest reading is saturated: it stands several times in one scan, in
    three scans or more, and is more frequent than everything in the tenth below it; at a wall
    that happens to be the farthest there are readings just below.

    Args:
        ranges: `[T, B]` readings as recorded, NaN where there is no beam.

    Returns:
        The smallest reading that means "no return", or None where neither sign is there.
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
