"""Correct the ranges of a log: the interval of the lidar and the motion during a scan."""

import dataclasses
from typing import TYPE_CHECKING

from jaxslam.io.log import SensorLog
from jaxslam.io.ranges import clean_ranges
from jaxslam.preprocess.deskew import SweepTiming, deskew, sweep_timing

if TYPE_CHECKING:  # Not at run time: the settings import JAX.
    from jaxslam.config.lidar import LidarSettings
    from jaxslam.config.lidar_presets import LidarPreset


def correct_scans(
    log: SensorLog, lidar: "LidarPreset | LidarSettings"
) -> tuple[SensorLog, SweepTiming | None]:
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
