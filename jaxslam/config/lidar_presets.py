"""Lidar presets, and their detection from the scans of a log.

This module uses NumPy only, so that the command line starts quickly.
"""

import math
from dataclasses import dataclass

import numpy as np

from jaxslam.core.names import did_you_mean
from jaxslam.io.log import LogError, ScanTrack, SensorLog

_MAX_FIELD_OF_VIEW_ERROR = math.radians(12.0)
"""Largest difference between a preset's and a log's field of view, radians: drivers may drop outer beams."""
_MAX_COST = 2.0
"""Cost above which no preset fits."""


@dataclass(frozen=True)
class LidarPreset:
    """Properties of a lidar: the ranges that the filter uses, and the format of its scans in a log.

    `usable_range`, `min_range`, `max_range`, `turn_time` and `max_lag` are those of `LidarSettings`.

    Attributes:
        name: name for `--lidar NAME`.
        log_max_ranges: maximum ranges that logs of this lidar report, meters.
        num_beams: possible numbers of beams per scan. A preset without them is never detected automatically.
        field_of_view: field of view, radians.
        rate: scans per second.
    """

    name: str
    usable_range: float
    min_range: float
    max_range: float
    log_max_ranges: tuple[float, ...] = ()
    num_beams: tuple[int, ...] = ()
    field_of_view: float = 0.0
    rate: float = 0.0
    turn_time: float = 0.0
    max_lag: float = 0.5


# Ranges, beams and rates are from the manufacturers' data sheets. The SICK reaches 80 m, but at 16 m its
# beams are 28 cm apart, so more distant returns contribute little to a match.
PRESETS: dict[str, LidarPreset] = {
    preset.name: preset
    for preset in (
        LidarPreset("sick", 16.0, 0.05, 80.0, (8.0, 80.0), (180, 181, 360, 361), math.pi, 37.5, 1 / 75),
        LidarPreset("urg-04lx", 5.5, 0.02, 5.6, (4.0, 5.6), (682, 683), math.radians(240), 10.0, 0.1),
        LidarPreset("rplidar-a1", 6.0, 0.15, 6.0, (6.0, 12.0), (360,), 2 * math.pi, 5.5, 1 / 5.5),
        LidarPreset("lds-01", 3.5, 0.12, 3.5, (3.5,), (360,), 2 * math.pi, 5.0, 0.2),
        LidarPreset("lds-02", 8.0, 0.16, 8.0, (8.0,), (240, 260), 2 * math.pi, 9.0, 1 / 9),
        # A single ring. Scans cut from a point cloud have no typical format.
        LidarPreset("vlp-16", 16.0, 0.5, 100.0, turn_time=0.1),
    )
}

_MAKERS = {"hokuyo": "urg-04lx", "slamtec": "rplidar-a1", "turtlebot3": "lds-02", "velodyne": "vlp-16"}
"""Preset by the maker of the lidar, or by the robot that carries it."""

_GENERIC_USABLE_RANGE = 8.0
"""Upper limit of the usable range if no preset fits, meters."""


def lidar_preset(name: str) -> LidarPreset:
    """Return the preset with a given name.

    Raises:
        ValueError: no preset has this name; the message suggests the closest match.
    """
    if name not in PRESETS:
        hint = did_you_mean(_MAKERS.get(name.lower(), name.lower()), PRESETS)
        makers = ", ".join(f"{maker}: {preset}" for maker, preset in _MAKERS.items())
        known = f"There are {', '.join(PRESETS)} ({makers}); name none for another lidar"
        raise ValueError(f"no lidar preset is called {name!r}: {hint}{known}")
    return PRESETS[name]


def detect_lidar(log: SensorLog) -> LidarPreset:
    """Return the preset that fits the scans of a log best.

    A preset with another field of view is excluded. The number of beams, the maximum range and the rate are
    compared by ratio. The costs of range and rate are limited, because the maximum range may be the driver's
    instead of the sensor's, and the log may be thinned.

    Returns:
        A preset. If none fits, a preset called `generic` with the ranges of the log.

    Raises:
        LogError: the log has no scans.
    """
    if log.scans is None or len(log.scans.stamps) == 0:
        other = ", or fuse its odometry and IMU with `jaxslam fuse`" if log.imu else ""
        raise LogError(f"{log.path}: the log has no laser scans: give a log with scans{other}")
    costs = {name: _cost(preset, log.scans) for name, preset in PRESETS.items() if preset.num_beams}
    name = min(costs, key=lambda name: costs[name])
    if costs[name] <= _MAX_COST:
        return PRESETS[name]
    low, high = log.scans.range_min, log.scans.range_max
    return LidarPreset("generic", min(_GENERIC_USABLE_RANGE, high), low, high)


def _cost(preset: LidarPreset, scans: ScanTrack) -> float:
    num_beams = float(np.median(scans.num_beams))
    increment = abs(float(np.median(scans.angle_increment)))
    # A full circle of n beams spans n steps. An arc of n beams spans n − 1 steps or, in CARMEN logs with an
    # even number of beams, n steps.
    spans = (increment * (num_beams - 1), increment * num_beams)
    error = min(abs(span - preset.field_of_view) for span in spans)
    if error > _MAX_FIELD_OF_VIEW_ERROR:
        return math.inf
    beams = min(_ratio(num_beams, count) for count in preset.num_beams)
    reach = min(_ratio(scans.range_max, reach) for reach in preset.log_max_ranges)
    intervals = np.diff(scans.stamps)
    interval = float(np.median(intervals)) if intervals.size else 0.0
    rate = _ratio(1.0 / interval, preset.rate) if interval > 0 else 0.0
    return beams + min(reach, 1.0) + min(rate, 0.5)


def _ratio(value: float, expected: float) -> float:
    """Return |ln(value / expected)|: 0 for equal values, 0.7 for a factor of two."""
    return abs(math.log(value / expected)) if value > 0 else math.inf
