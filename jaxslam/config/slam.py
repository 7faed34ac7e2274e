"""Everything that decides a run besides the log and the seed, as one frozen pytree."""

import dataclasses
import difflib

import equinox as eqx
from jaxtyping import Array, Float

from jaxslam.config.dotted import UNSET, update
from jaxslam.config.fusion import FusionSettings
from jaxslam.config.lidar import LidarSettings
from jaxslam.config.lidar_presets import LidarPreset
from jaxslam.config.registry import kind
from jaxslam.config.thinning import Thinning
from jaxslam.core.validation import require_number
from jaxslam.grid.distance import MAX_RADIUS
from jaxslam.grid.occupancy import OccupancyModel
from jaxslam.motion import AbstractMotionModel, OdometryMotion
from jaxslam.proposal.base import AbstractProposal
from jaxslam.proposal.matched import MatchedProposal
from jaxslam.resampling import AdaptiveResampling, SystematicResampler
from jaxslam.sensor.base import AbstractSensorModel
from jaxslam.sensor.likelihood_field import LikelihoodField
from jaxslam.slam.rbpf import RBPF

Number = float | Float[Array, ""]

METHODS: dict[str, dict[str, str]] = {
    "rbpf": {"proposal.kind": "motion"},
    "gmapping": {"proposal.kind": "matched"},
    "fruit-fly": {"proposal.kind": "fruit_fly", "fusion.use": "auto"},
    "gaussian": {"proposal.kind": "gaussian"},
}
"""What a method sets: `rbpf` is the traditional filter, `gmapping` matches scans, `fruit-fly` is the first
paper's, with odometry and IMU fused where there is one, and a swarm; `gaussian` the second paper's."""


class MapSettings(eqx.Module):
    """Cells and extent of the maps.

    Attributes:
        resolution: side of a cell, meters.
        margin: room around the odometry's path beyond the usable range, meters: what it may be wrong by.
        margin_share: and so much more per meter of the path's longer side: a heading that drifts turns it.
        window: side of the square that a step works on, meters, if the usable range is not shorter. It lies
            around the lidar, and ahead of one that sees farther.
        radius: truncation of the distance field, cells, 1 to 10 (static).
    """

    resolution: Number = 0.05
    margin: Number = 12.0
    margin_share: Number = 0.3
    window: Number = 16.0
    radius: int = eqx.field(static=True, default=RBPF.__dataclass_fields__["radius"].default)

    def __check_init__(self):
        require_number(self, "resolution", lambda value: value > 0, "a number of meters above 0")
        require_number(self, "margin", lambda value: value >= 0, "a number of meters, 0 or more")
        require_number(self, "margin_share", lambda value: value >= 0, "a number, 0 or more")
        require_number(self, "window", lambda value: value > 0, "a number of meters above 0")
        if not 1 <= self.radius <= MAX_RADIUS:
            raise ValueError(f"map.radius is {self.radius}: give 1 to {MAX_RADIUS} cells")


class SlamConfig(eqx.Module):
    """A whole filter and how it is fed. Floats are traced, sizes and choices static.

    Attributes:
        num_particles: N, particles, each with a map of its own (static).
        lidar: ranges of the sensor; None: `prepare` chooses the preset by the scans of the log.
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
    lidar: LidarSettings | None = eqx.field(default=None, metadata={UNSET: LidarSettings.from_preset("sick")})
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

    @property
    def method(self) -> str:
        """The name in `METHODS` of the proposal; the proposal's own name where it has none there."""
        proposal = kind(self.proposal)
        names = {settings["proposal.kind"]: method for method, settings in METHODS.items()}
        return names.get(proposal, proposal)

    def with_lidar(self, preset: LidarPreset | str) -> "SlamConfig":
        """Return the configuration with the ranges of a lidar, given by preset or name of a preset."""
        return dataclasses.replace(self, lidar=LidarSettings.from_preset(preset))

    def with_method(self, method: str) -> "SlamConfig":
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
