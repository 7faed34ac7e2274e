"""Correct the ranges of a log: the interval of the lidar and the motion during a scan."""

import dataclasses
from typing import Any, Protocol, runtime_checkable

from jaxslam.io.log import SensorLog
from jaxslam.io.ranges import clean_ranges
from jaxslam.preprocess.deskew import SweepTiming, deskew, sweep_timing


@runtime_checkable
class LidarRanges(Protocol):
    """The part of `LidarSettings` that the correction needs; this module imports no JAX."""

    @property
    def min_range(self) -> Any: ...  # noqa: D102
    @property
    def max_range(self) -> Any: ...  # noqa: D102
    @property
    def turn_time(self) -> Any: ...  # noqa: D102
    @property
    def max_lag(self) -> Any: ...  # noqa: D102


def correct_scans(log: SensorLog, lidar: LidarRanges) -> tuple[SensorLog, SweepTiming | None]:
    """Return the log with its ranges limited to the lidar's interval and its scans deskewed.

    Returns:
        The log, with readings outside the lidar's interval replaced by NaN ("no return") and without the
        robot's motion during a scan; and the timing used for deskewing, None if it is unknown.
    """
    scans = log.scans
    if scans is not None:  # The maximum stated by drivers is often too large.
        ranges = clean_ranges(scans.ranges, float(lidar.min_range), float(lidar.max_range))
        log = dataclasses.replace(log, scans=dataclasses.replace(scans, ranges=ranges))
    timing = sweep_timing(log, float(lidar.turn_time), float(lidar.max_lag))
    return (log if timing is None else deskew(log, timing)), timing
