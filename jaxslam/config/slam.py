"""The configuration of a mapping run: everything except the log and the seed, as one frozen pytree."""

import dataclasses
from collections.abc import Mapping

import equinox as eqx

from jaxslam.config.dotted import UNSET, update
from jaxslam.config.fusion import FusionSettings
from jaxslam.config.lidar import LidarSettings, Number
from jaxslam.config.lidar_presets import LidarPreset
from jaxslam.config.registry import kind
from jaxslam.config.thinning import Thinning
from jaxslam.core.names import check_names
from jaxslam.core.validation import require_count, require_number
from jaxslam.grid.distance import MAX_RADIUS
from jaxslam.grid.occupancy import OccupancyModel
from jaxslam.motion import AbstractMotionModel, OdometryMotion
from jaxslam.proposal.base import AbstractProposal
from jaxslam.proposal.matched import MatchedProposal
from jaxslam.resampling import AdaptiveResampling, SystematicResampler
from jaxslam.sensor.base import AbstractSensorModel
from jaxslam.sensor.likelihood_field import LikelihoodField
from jaxslam.slam.rbpf import RBPF

METHODS: dict[str, dict[str, str]] = {
    "rbpf": {"proposal.kind": "motion"},
    "gmapping": {"proposal.kind": "matched"},
    "fruit-fly": {"proposal.kind": "fruit_fly", "fusion.use": "auto"},
    "gaussian": {"proposal.kind": "gaussian"},
}
"""Settings of each method.

`rbpf` is the traditional filter. `gmapping` matches scans. `fruit-fly` is the filter of Liang et al.: it
fuses odometry and IMU if the log has an IMU, and refines poses with a swarm. `gaussian` is the filter of Yang
et al. 2019.
"""


class MapSettings(eqx.Module):
    """Cells and extent of the maps.

    Attributes:
        resolution: Side of a cell, meters.
        margin: Map margin around the odometry path beyond the usable range, meters. It must exceed the drift
            of the odometry in position.
        margin_share: Additional map margin per meter of the longer side of the odometry path's bounding box,
            meters per meter. It allows for the drift of the odometry in heading.
        window: Side of the square map window that a step processes, meters. A shorter usable range
            reduces the window. The window lies around the lidar, or ahead of a lidar that sees beyond it.
        radius: Truncation distance of the distance field, cells, 1 to 10 (static).
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
    """Configuration of a mapping run. Floats are traced; sizes and choices are static.

    Attributes:
        num_particles: Number of particles, N. Each particle has its own map (static).
        lidar: Ranges of the lidar. None lets `prepare` detect the preset from the scans of the log.
        thinning: Rule for which scans are processed (static, because it determines the number of steps).
        map: Cells and extent of the maps.
        fusion: Fusion of odometry and IMU before the filter.
        motion: Motion model, p(x_t | x_{t−1}, u_t).
        sensor: Sensor model, p(z_t | x_t, m).
        proposal: Proposal distribution, from which the poses of the particles are drawn.
        resampling: Resampling scheme and its threshold.
        occupancy: Occupancy update of a map by a scan.
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
        require_count(self, "num_particles")

    @property
    def method(self) -> str:
        """Name of the method that uses this proposal; the name of the proposal if no method uses it."""
        proposal = kind(self.proposal).rpartition(":")[2]
        names = {settings["proposal.kind"]: method for method, settings in METHODS.items()}
        return names.get(proposal, proposal)

    def with_lidar(self, preset: LidarPreset | str) -> "SlamConfig":
        """Return a copy with the ranges of a lidar preset, given as an object or by name."""
        return dataclasses.replace(self, lidar=LidarSettings.from_preset(preset))

    def with_method(self, method: str) -> "SlamConfig":
        """Return a copy with the settings of a method from `METHODS`.

        A proposal that already has the method's kind keeps its settings.

        Raises:
            ValueError: no method has this name; the message suggests the closest match.
        """
        check_names("no method is called", METHODS, method)
        return update(self, METHODS[method], exact=True)

    def with_settings(self, settings: Mapping[str, object]) -> "SlamConfig":
        """Return a copy with settings changed by dotted name or unambiguous suffix.

        Raises:
            ValueError: a name is unknown or ambiguous, or a value has the wrong type or is out of range.

        Example:
            `SlamConfig().with_settings({"sensor.sigma_hit": 0.1, "proposal": "motion"})`
        """
        return update(self, settings)
