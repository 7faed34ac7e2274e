"""Everything that decides a run besides the log and the seed, as one frozen pytree."""

import dataclasses
import difflib
import math
from collections.abc import Callable

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float, Float64

from jaxslam.fusion.settings import FusionSettings
from jaxslam.grid.distance import MAX_RADIUS
from jaxslam.grid.occupancy import OccupancyModel
from jaxslam.grid.spec import GridSpec
from jaxslam.inputs import Thinning
from jaxslam.io.log import SensorLog
from jaxslam.io.sweep import SweepTiming, at_rest, sweep_timing
from jaxslam.memory import physical_memory
from jaxslam.motion import AbstractMotionModel, OdometryMotion
from jaxslam.presets import PRESETS, LidarPreset
from jaxslam.proposal.base import AbstractProposal
from jaxslam.proposal.matched import MatchedProposal
from jaxslam.range_network.network import RangeNetwork
from jaxslam.resampling import AdaptiveResampling, SystematicResampler
from jaxslam.sensor.base import AbstractSensorModel
from jaxslam.sensor.field import window_rows
from jaxslam.sensor.likelihood_field import LikelihoodField
from jaxslam.settings import update
from jaxslam.slam.rbpf import RBPF
from jaxslam.variants import kind

Number = float | Float[Array, ""]

METHODS: dict[str, dict[str, str]] = {
    "rbpf": {"proposal.kind": "motion"},
    "gmapping": {"proposal.kind": "matched"},
    "fruit-fly": {"proposal.kind": "fruit_fly", "fusion.use": "auto"},
    "gaussian": {"proposal.kind": "gaussian"},
}
"""What a method sets: `rbpf` is the traditional filter, `gmapping` matches scans, `fruit-fly` is the first
paper's, with odometry and IMU fused where there is one, and a swarm; `gaussian` the second paper's."""

_MAX_CELLS = 2**31 - 1


def _require(module: eqx.Module, name: str, holds: Callable[[float], bool], wanted: str) -> None:
    """Checks a number of a settings module. A traced one cannot be looked at; NaN never holds."""
    value = getattr(module, name)
    if isinstance(value, float) and not (math.isfinite(value) and holds(value)):
        part = type(module).__name__.removesuffix("Settings").lower()
        raise ValueError(f"{part}.{name} is {value}: give {wanted}")


class LidarSettings(eqx.Module):
    """The ranges of the lidar, and when its beams are taken.

    Attributes:
        name: the preset they are from (static).
        usable_range: longer returns only clear the space before them, metres.
        min_range: shorter readings are no return, metres.
        max_range: readings at or over it are no return, metres.
        turn_time: of a whole turn, for logs that do not say when within a scan its beams were taken,
            seconds; 0: all at once.
        max_lag: how far the scans' stamps may be off the odometry's, which is estimated, seconds; 0 takes
            them as they are.
    """

    name: str = eqx.field(static=True)
    usable_range: Number
    min_range: Number
    max_range: Number
    turn_time: Number = 0.0
    max_lag: Number = 0.5

    def __check_init__(self):
        _require(self, "usable_range", lambda value: value > 0, "a number of metres above 0")
        _require(self, "min_range", lambda value: value >= 0, "a number of metres, 0 or more")
        _require(self, "max_range", lambda value: value > 0, "a number of metres above 0")
        _require(self, "turn_time", lambda value: value >= 0, "a number of seconds, 0 or more")
        _require(self, "max_lag", lambda value: value >= 0, "a number of seconds, 0 or more")
        low, high = self.min_range, self.max_range
        if isinstance(low, float) and isinstance(high, float) and not low < high:
            raise ValueError(f"lidar.min_range is {low} m and lidar.max_range {high} m: exchange them")

    @classmethod
    def of(cls, preset: LidarPreset) -> "LidarSettings":
        """The settings of a preset."""
        return cls(preset.name, preset.usable_range, preset.min_range, preset.max_range, preset.turn_time)


class MapSettings(eqx.Module):
    """Cells and extent of the maps.

    Attributes:
        resolution: side of a cell, metres.
        margin: room around the odometry's path beyond the usable range, metres: what it may be wrong by.
        margin_share: and so much more per metre of the path's longer side: a heading that drifts turns it.
        window: side of the square that a step works on, metres, if the usable range is not shorter. It lies
            around the lidar, and ahead of one that sees farther.
        radius: truncation of the distance field, cells, 1 to 10 (static).
    """

    resolution: Number = 0.05
    margin: Number = 12.0
    margin_share: Number = 0.3
    window: Number = 16.0
    radius: int = eqx.field(static=True, default=RBPF.__dataclass_fields__["radius"].default)

    def __check_init__(self):
        _require(self, "resolution", lambda value: value > 0, "a number of metres above 0")
        _require(self, "margin", lambda value: value >= 0, "a number of metres, 0 or more")
        _require(self, "margin_share", lambda value: value >= 0, "a number, 0 or more")
        _require(self, "window", lambda value: value > 0, "a number of metres above 0")
        if not 1 <= self.radius <= MAX_RADIUS:
            raise ValueError(f"map.radius is {self.radius}: give 1 to {MAX_RADIUS} cells")


class Configuration(eqx.Module):
    """A whole filter and how it is fed. Floats are traced, sizes and choices static.

    Attributes:
        num_particles: N, particles, each with a map of its own (static).
        lidar: ranges of the sensor.
        thinning: which scans are processed (static: it decides how many steps there are).
        map: cells and extent of the maps.
        fusion: whether and how odometry is fused with an IMU first.
        motion: p(x_t | x_{t−1}, u_t).
        sensor: p(z_t | x_t, m).
        proposal: where the particles go.
        resampling: when and how to resample.
        occupancy: what a scan adds to a map.
    """

    num_particles: int = eqx.field(static=True, default=30)
    lidar: LidarSettings = LidarSettings.of(PRESETS["sick"])
    thinning: Thinning = eqx.field(static=True, default=Thinning())
    map: MapSettings = MapSettings()
    fusion: FusionSettings = FusionSettings()
    motion: AbstractMotionModel = OdometryMotion()
    sensor: AbstractSensorModel = LikelihoodField()
    proposal: AbstractProposal = MatchedProposal()
    resampling: AdaptiveResampling = AdaptiveResampling(SystematicResampler())
    occupancy: OccupancyModel = OccupancyModel()

    def __check_init__(self):
        if self.num_particles < 1:
            raise ValueError(f"num_particles is {self.num_particles}: give 1 or more")
        for name, value in dataclasses.asdict(self.thinning).items():
            if not value >= 0:
                raise ValueError(f"thinning.{name} is {value}: give 0 or more")

    @property
    def method(self) -> str:
        """The name in `METHODS` of the proposal; the proposal's own name where it has none there."""
        proposal = kind(self.proposal)
        names = {settings["proposal.kind"]: method for method, settings in METHODS.items()}
        return names.get(proposal, proposal)

    def with_lidar(self, preset: LidarPreset) -> "Configuration":
        """The same with the ranges of a lidar."""
        return dataclasses.replace(self, lidar=LidarSettings.of(preset))

    def with_method(self, method: str) -> "Configuration":
        """The same with what a method of `METHODS` sets; a proposal of that kind is kept.

        Raises:
            ValueError: there is no such method; the message names the nearest.
        """
        if method not in METHODS:
            nearest = difflib.get_close_matches(method, METHODS, n=1, cutoff=0.0)[0]
            raise ValueError(
                f"no method is called {method!r}: did you mean {nearest!r}? There are {', '.join(METHODS)}"
            )
        return update(self, METHODS[method], exact=True)


def build(
    configuration: Configuration,
    odometry_bounds: Float64[np.ndarray, "2 2"],
    range_network: RangeNetwork | None = None,
) -> RBPF:
    """The filter of a configuration, its maps sized for a path.

    Args:
        configuration: see there.
        odometry_bounds: `[2, 2]` lower and upper corner of the odometry's path, metres.
        range_network: corrects the ranges of every scan.

    Raises:
        ValueError: the maps would not fit into memory.

    Example:
        A path of 10 × 5 m, margin 12 m and 0.3 per metre, usable range 8 m, cells of 5 cm: 56 × 51 m.
    """
    reach, resolution = float(configuration.lidar.usable_range), float(configuration.map.resolution)
    longer_side = float(np.max(odometry_bounds[1] - odometry_bounds[0]))
    margin = float(configuration.map.margin) + float(configuration.map.margin_share) * longer_side
    around = reach + margin
    radius = configuration.map.radius
    # A range that is a whole number of cells must not get one more by rounding.
    half_window = math.ceil(min(reach, float(configuration.map.window) / 2) / resolution - 1e-6) + radius + 1
    window_size = -(-2 * half_window // 4) * 4
    lower, upper = odometry_bounds[0] - around, odometry_bounds[1] + around
    # The window must find room in a map with a small margin, too.
    missing = np.maximum(window_rows(window_size, radius) * resolution - (upper - lower), 0.0)
    lower, upper = lower - missing / 2, upper + missing / 2
    _check_memory(configuration, upper - lower)
    return RBPF(
        grid=GridSpec.covering(lower, upper, resolution),
        motion=configuration.motion,
        sensor=configuration.sensor,
        proposal=configuration.proposal,
        resampling=configuration.resampling,
        occupancy=configuration.occupancy,
        usable_range=configuration.lidar.usable_range,
        range_network=range_network,
        num_particles=configuration.num_particles,
        window_size=window_size,
        radius=radius,
    )


def correct_scans(log: SensorLog, lidar: LidarSettings) -> tuple[SensorLog, SweepTiming | None]:
    """The log with its scans as a lidar at rest, that reports what it can see, would have taken them.

    Returns:
        The log with readings outside of the lidar's interval turned into "no return" (NaN) and the robot's
        motion during a scan taken out; and what that was found from, None where the log cannot tell.
    """
    log = _within_range(log, lidar)
    timing = sweep_timing(log, float(lidar.turn_time), float(lidar.max_lag))
    return (log if timing is None else at_rest(log, timing)), timing


def _within_range(log: SensorLog, lidar: LidarSettings) -> SensorLog:
    """Drivers often state a far larger maximum than the sensor has and pass its ghosts on."""
    if log.scans is None:
        return log
    ranges = log.scans.ranges
    with np.errstate(invalid="ignore"):
        outside = (ranges < float(lidar.min_range)) | (ranges >= float(lidar.max_range))
    ranges = np.where(outside, np.float32(np.nan), ranges)
    return dataclasses.replace(log, scans=dataclasses.replace(log.scans, ranges=ranges))


def _check_memory(configuration: Configuration, extent: Float64[np.ndarray, "2"]) -> None:
    cells = float(np.prod(np.ceil(extent / float(configuration.map.resolution))))
    # One byte per cell and particle, and as much again while particles are resampled.
    needed = 2 * cells * configuration.num_particles
    available = physical_memory()
    if cells > _MAX_CELLS or needed > available:
        raise ValueError(
            f"{configuration.num_particles} maps of {extent[0]:.0f} × {extent[1]:.0f} m need "
            f"{needed / 1e9:.3g} GB of the {available / 1e9:.3g} GB there are: lower num_particles or "
            "map.margin, or raise map.resolution"
        )
