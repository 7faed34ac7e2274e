"""Repair of time stamps: sort jitter, detect clocks that jump back, spread repeated stamps."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float64, Int64

# Messages of several processes reach a logger out of order by milliseconds, or over a network by a few
# tenths of a second. A clock that was set back jumps by more; then the true order is unknown.
MAX_BACKWARD_S = 1.0


class BackwardSteps(NamedTuple):
    """Extent of backward steps in stamps.

    Attributes:
        num_backward: number of stamps smaller than an earlier one.
        largest: the largest lag behind an earlier stamp, seconds; 0 for sorted stamps.
        row: row of that lag.
    """

    num_backward: int
    largest: float
    row: int


def backward_steps(stamps: Float64[np.ndarray, "M"]) -> BackwardSteps:
    """Measure the disorder of stamps `[M]` in seconds."""
    if stamps.size == 0:
        return BackwardSteps(0, 0.0, 0)
    lag = np.maximum.accumulate(stamps) - stamps
    row = int(np.argmax(lag))
    return BackwardSteps(int(np.count_nonzero(lag > 0)), float(lag[row]), row)


def sorting_order(stamps: Float64[np.ndarray, "M"], name: str, warnings: list[str]) -> Int64[np.ndarray, "M"]:
    """Return the row order that sorts the stamps; equal stamps keep the order of the file.

    If stamps run back, a line about the messages called `name` is appended to `warnings`.
    """
    steps = backward_steps(stamps)
    if steps.num_backward:
        warnings.append(
            f"{name}: {steps.num_backward} stamps run back by up to {steps.largest:.3f} s: sorted by time"
        )
    return np.argsort(stamps, kind="stable").astype(np.int64)


def nearest_rows(
    stamps: Float64[np.ndarray, "M"], queries: Float64[np.ndarray, "*any"]
) -> Int64[np.ndarray, "*any"]:
    """Return the row of the sorted stamp nearest to each query, the earlier one of a tie; M ≥ 1."""
    after = np.clip(np.searchsorted(stamps, queries), 0, len(stamps) - 1)
    before = np.maximum(after - 1, 0)
    return np.where(queries - stamps[before] <= stamps[after] - queries, before, after)


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
