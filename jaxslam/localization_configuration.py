"""Everything that decides a localisation besides the log, the map, the start and the seed."""

import dataclasses
import math

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from jaxslam.checks import require_at_least_zero
from jaxslam.configuration import LidarSettings
from jaxslam.inputs import Thinning
from jaxslam.io.map_server import OccupancyMap
from jaxslam.localization import (
    AMCL,
    Agreement,
    Bins,
    Clustering,
    FieldModel,
    KLDSampling,
    KnownMap,
    Recovery,
)
from jaxslam.localization.scan_model import AbstractScanModel
from jaxslam.memory import physical_memory
from jaxslam.motion import AbstractMotionModel, OdometryMotion
from jaxslam.presets import PRESETS, LidarPreset
from jaxslam.range_network.network import RangeNetwork

Number = float | Float[Array, ""]

_MAX_BINS = 2**27
_BYTES_PER_PARTICLE = 200
"""Before and after a step and while it works: 137 by the compiler, and some for the pictures."""
_WIDEST_START = 1e4


class StartSettings(eqx.Module):
    """How well a start that is given is known.

    Attributes:
        deviation: standard deviation of its x and of its y, metres.
        rotation_deviation: and of its heading, radians.
    """

    deviation: Number = 0.5
    rotation_deviation: Number = 0.26

    def __check_init__(self):
        require_at_least_zero(self)
        for name in ("deviation", "rotation_deviation"):
            value = getattr(self, name)
            if isinstance(value, float) and value > _WIDEST_START:
                raise ValueError(f"start.{name} is {value:g}: a start that unsure is --global")


class BinSettings(eqx.Module):
    """Bins over poses, which say how far the particles are spread.

    Attributes:
        translation: side of a bin, metres.
        rotation: width of a bin, radians.
    """

    translation: Number = 0.5
    rotation: Number = math.pi / 18

    def __check_init__(self):
        require_at_least_zero(self, positive=("translation", "rotation"))


class LocalizationConfiguration(eqx.Module):
    """A whole localisation and how it is fed. Floats are traced, sizes and choices static.

    Attributes:
        max_particles: N, room for particles; a global start fills it (static).
        max_distance: end points farther than this from any obstacle are all alike, metres.
        resample_below: resample where the effective sample size is under this share of the particles; over
            1 resamples in every step.
        min_valid_beams: a scan with fewer among those that are looked at moves the particles by odometry
            alone.
        lidar: ranges of the sensor.
        thinning: which scans are processed (static: it decides how many steps there are).
        start: how well a start that is given is known.
        bins: to count where particles are.
        motion: p(x_t | x_{t−1}, u_t).
        scan_model: p(z_t | x_t, m).
        sampling: how many particles are needed.
        recovery: how many of them come from the whole map.
        clustering: where the estimate is.
        agreement: what counts as converged and as lost.
    """

    max_particles: int = eqx.field(static=True, default=100_000)
    max_distance: Number = 2.0
    resample_below: Number = 0.5
    min_valid_beams: Number = 5.0
    lidar: LidarSettings = LidarSettings.of(PRESETS["sick"])
    thinning: Thinning = eqx.field(static=True, default=Thinning())
    start: StartSettings = StartSettings()
    bins: BinSettings = BinSettings()
    motion: AbstractMotionModel = OdometryMotion()
    scan_model: AbstractScanModel = FieldModel()
    sampling: KLDSampling = KLDSampling()
    recovery: Recovery = Recovery()
    clustering: Clustering = Clustering()
    agreement: Agreement = Agreement()

    def __check_init__(self):
        if self.max_particles < 1:
            raise ValueError(f"max_particles is {self.max_particles}: give 1 or more")
        for name, value in dataclasses.asdict(self.thinning).items():
            if not value >= 0:
                raise ValueError(f"thinning.{name} is {value}: give 0 or more")
        require_at_least_zero(self, positive=("max_distance",))

    def with_lidar(self, preset: LidarPreset) -> "LocalizationConfiguration":
        """The same with the ranges of a lidar."""
        return dataclasses.replace(self, lidar=LidarSettings.of(preset))


def require_memory(configuration: LocalizationConfiguration) -> None:
    """Raises a `ValueError` where the particles would not fit into memory."""
    needed, available = configuration.max_particles * _BYTES_PER_PARTICLE, physical_memory()
    if needed > available or configuration.max_particles >= 2**31:
        raise ValueError(
            f"{configuration.max_particles} particles need {needed / 1e9:.3g} GB of the "
            f"{available / 1e9:.3g} GB there are: lower max_particles"
        )


def build_localizer(
    configuration: LocalizationConfiguration,
    occupancy: OccupancyMap,
    range_network: RangeNetwork | None = None,
) -> AMCL:
    """The filter of a configuration on a map, with the network that corrects its ranges, if any.

    Raises:
        ValueError: the map has no obstacle or no free space, the bins are too small for it, or the particles
            would not fit into memory.
    """
    require_memory(configuration)
    known = KnownMap.of(occupancy, float(configuration.max_distance))
    bins = Bins.over(known, float(configuration.bins.translation), float(configuration.bins.rotation))
    if bins.count > _MAX_BINS:
        extent = np.asarray(known.shape) * float(known.resolution)
        raise ValueError(
            f"{bins.count:.2g} bins on a map of {extent[1]:.0f} × {extent[0]:.0f} m: raise "
            "bins.translation or bins.rotation"
        )
    return AMCL(
        known=known,
        table=configuration.scan_model.prepare(known),
        bins=bins,
        motion=configuration.motion,
        scan_model=configuration.scan_model,
        sampling=configuration.sampling,
        recovery=configuration.recovery,
        clustering=configuration.clustering,
        agreement=configuration.agreement,
        resample_below=configuration.resample_below,
        min_valid_beams=configuration.min_valid_beams,
        range_network=range_network,
        max_particles=configuration.max_particles,
    )
