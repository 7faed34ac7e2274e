"""Lidar presets, and the one that a log's scans look like. NumPy only: the command line starts quickly."""

import difflib
import math
from dataclasses import dataclass

import numpy as np

from jaxslam.io.log import LogError, ScanTrack, SensorLog

_MAX_FIELD_OF_VIEW_ERROR = math.radians(12.0)
"""A sensor that loses its outermost beams still has its field of view within this."""
_MAX_COST = 2.0


@dataclass(frozen=True)
class LidarPreset:
    """What is known of a lidar: the ranges the filter uses, and how its scans look in a log.

    Attributes:
        name: as in `--lidar NAME`.
        usable_range: longer returns only clear the space before them, meters.
        min_range: shorter readings are no return, meters.
        max_range: readings at or over it are no return, meters.
        log_max_ranges: maximum ranges that logs of it state, meters.
        num_beams: beams that its scans have.
        field_of_view: radians.
        rate: scans per second.
        turn_time: of a whole turn, over which the beams of a scan are taken one by one, seconds.
        planar: whether it gives planar scans by itself; what is cut from a cloud cannot be told by its looks.
        max_lag: largest lag between scans and odometry that is looked for, seconds.
    """

    name: str
    usable_range: float
    min_range: float
    max_range: float
    log_max_ranges: tuple[float, ...]
    num_beams: tuple[int, ...]
    field_of_view: float
    rate: float
    turn_time: float
    planar: bool = True
    max_lag: float = 0.5


# Ranges, beams and rates: the makers' data sheets. The SICK reaches 80 m, but at 16 m its beams are 28 cm
# apart, and few of them add to a match.
PRESETS: dict[str, LidarPreset] = {
    preset.name: preset
    for preset in (
        LidarPreset("sick", 16.0, 0.05, 80.0, (8.0, 80.0), (180, 181, 360, 361), math.pi, 37.5, 1 / 75),
        LidarPreset("urg-04lx", 5.5, 0.02, 5.6, (4.0, 5.6), (682, 683), math.radians(240), 10.0, 0.1),
        LidarPreset("rplidar-a1", 6.0, 0.15, 6.0, (6.0, 12.0), (360,), 2 * math.pi, 5.5, 1 / 5.5),
        LidarPreset("lds-01", 3.5, 0.12, 3.5, (3.5,), (360,), 2 * math.pi, 5.0, 0.2),
        LidarPreset("lds-02", 8.0, 0.16, 8.0, (8.0,), (240, 260), 2 * math.pi, 9.0, 1 / 9),
        # One ring of it.
        LidarPreset("vlp-16", 16.0, 0.5, 100.0, (100.0,), (900, 1800), 2 * math.pi, 10.0, 0.1, False),
    )
}

GENERIC_USABLE_RANGE = 8.0
"""Usable range where no preset fits, meters, if the sensor reaches that far."""


def lidar_preset(name: str) -> LidarPreset:
    """The preset of that name.

    Raises:
        ValueError: there is none; the message names the nearest.
    """
    if name not in PRESETS:
        nearest = difflib.get_close_matches(name.lower(), PRESETS, n=1, cutoff=0.0)[0]
        raise ValueError(
            f"no lidar preset is called {name!r}: did you mean {nearest!r}? There are {', '.join(PRESETS)}"
        )
    return PRESETS[name]


def detect_lidar(log: SensorLog) -> LidarPreset:
    """The preset whose scans look most like those of a log.

    The field of view decides first. Then beams, maximum range and rate are compared by ratio; a
    maximum range that is the driver's and not the sensor's, or a thinned log, counts only so much.

    Returns:
        A preset, or one called `generic` with the log's own ranges where none fits.

    Raises:
        LogError: the log has no scans.
    """
    if log.scans is None or len(log.scans.stamps) == 0:
        raise LogError(f"{log.path}: no laser scans in it, so there is nothing to map (see `jaxslam info`)")
    costs = {name: _cost(preset, log.scans) for name, preset in PRESETS.items() if preset.planar}
    name = min(costs, key=lambda name: costs[name])
    return PRESETS[name] if costs[name] <= _MAX_COST else _generic(log.scans)


def _cost(preset: LidarPreset, scans: ScanTrack) -> float:
    num_beams = float(np.median(scans.num_beams))
    increment = abs(float(np.median(scans.angle_increment)))
    # A full circle of n beams spans n steps, an arc of n beams n − 1 or, in CARMEN's even counts, n.
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
    """|ln(value / expected)|: 0 where equal, 0.7 for twice or half."""
    return abs(math.log(value / expected)) if value > 0 else math.inf


def _generic(scans: ScanTrack) -> LidarPreset:
    num_beams = int(np.median(scans.num_beams))
    increment = abs(float(np.median(scans.angle_increment)))
    return LidarPreset(
        name="generic",
        usable_range=min(GENERIC_USABLE_RANGE, scans.range_max),
        min_range=scans.range_min,
        max_range=scans.range_max,
        log_max_ranges=(scans.range_max,),
        num_beams=(num_beams,),
        field_of_view=increment * num_beams,
        rate=1.0,
        turn_time=0.0,
    )
