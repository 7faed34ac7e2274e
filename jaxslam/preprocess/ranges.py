"""Correct the ranges of a log: the interval of the lidar and the motion during a scan."""

import dataclasses
from typing import Any, Protocol, runtime_checkable

import numpy as np

from jaxslam.io.log import SensorLog
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
    log = _within_range(log, lidar)
    timing = sweep_timing(log, float(lidar.turn_time), float(lidar.max_lag))
    return (log if timing is None else deskew(log, timing)), timing


def _within_range(log: SensorLog, lidar: LidarRanges) -> SensorLog:
    """Drop ranges outside the lidar's interval: the maximum stated by drivers is often too large."""
    if log.scans is None:
        return log
    ranges = log.scans.ranges
    with np.errstate(invalid="ignore"):
        outside = (ranges < float(lidar.min_range)) | (ranges >= float(lidar.max_range))
    ranges = np.where(outside, np.float32(np.nan), ranges)
    return dataclasses.replace(log, scans=dataclasses.replace(log.scans, ranges=ranges))
