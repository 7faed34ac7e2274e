"""Time stamps: find the nearest one, sort jitter, detect clocks that jump back, spread repeated stamps."""

import numpy as np
from jaxtyping import Float64, Int64, Real

# Messages of several processes reach a logger out of order by milliseconds, or over a network by a few
# tenths of a second. A clock that was set back jumps by more; then the true order is unknown.
MAX_BACKWARD_S = 1.0


def largest_step_back(stamps: Float64[np.ndarray, "M"]) -> tuple[float, int]:
    """Return the largest lag behind an earlier stamp, in seconds (0 for sorted stamps), and its row."""
    if stamps.size == 0:
        return 0.0, 0
    lag = np.maximum.accumulate(stamps) - stamps
    row = int(np.argmax(lag))
    return float(lag[row]), row


def sorting_order(stamps: Float64[np.ndarray, "M"], name: str, warnings: list[str]) -> Int64[np.ndarray, "M"]:
    """Return the row order that sorts the stamps; equal stamps keep the order of the file.

    If stamps run backwards, a line about the messages called `name` is appended to `warnings`.
    """
    num_back = np.count_nonzero(stamps < np.maximum.accumulate(stamps))
    if num_back:
        largest, _ = largest_step_back(stamps)
        warnings.append(f"{name}: {num_back} stamps run backwards by up to {largest:.3f} s: sorted by time")
    return np.argsort(stamps, kind="stable").astype(np.int64)


def nearest_rows(
    values: Float64[np.ndarray, "M"], queries: Real[np.ndarray, "*any"]
) -> Int64[np.ndarray, "*any"]:
    """Return the row of the value nearest to each query, the earlier one of a tie; `values` are sorted."""
    after = np.clip(np.searchsorted(values, queries), 0, len(values) - 1)
    before = np.maximum(after - 1, 0)
    return np.where(queries - values[before] <= values[after] - queries, before, after)


def spread_repeats(stamps: Float64[np.ndarray, "M"]) -> tuple[Float64[np.ndarray, "M"], int]:
    """Make sorted stamps strictly increasing by spreading runs of equal stamps.

    A run of k equal stamps is spread evenly up to the next stamp; a run at the end continues with the
    median period. Readings follow one another even if the clock does not advance, so this is closer to
    the truth than a time step of zero, which a motion model cannot use.

    Args:
        stamps: `[M]` seconds, not decreasing.

    Returns:
        The stamps `[M]` and the number of stamps that were moved.

    Example:
        `[0, 1, 1, 2]` becomes `[0, 1, 1.5, 2]`, one moved.
    """
    distinct, first, counts = np.unique(stamps, return_index=True, return_counts=True)
    moved = int(stamps.size - distinct.size)
    if moved == 0:
        return stamps.copy(), 0
    steps = np.diff(distinct)
    period = float(np.median(steps)) if steps.size else 1.0
    room = np.append(steps, period)
    within = np.arange(stamps.size) - np.repeat(first, counts)
    return stamps + within * np.repeat(room / counts, counts), moved
