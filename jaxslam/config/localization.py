"""Everything that decides a localization besides the log, the map, the start and the seed."""

import dataclasses
import math

import equinox as eqx
from jaxtyping import Array, Float

from jaxslam.config.dotted import UNSET
from jaxslam.config.lidar import LidarSettings
from jaxslam.config.lidar_presets import LidarPreset
from jaxslam.config.thinning import Thinning
from jaxslam.core.validation import require_at_least_zero
from jaxslam.localization import (
    Agreement,
    Clustering,
    KLDSampling,
    Recovery,
)
from jaxslam.localization.skipping import BeamSkipping
from jaxslam.motion import AbstractMotionModel, OdometryMotion
from jaxslam.sensor.base import AbstractSensorModel
from jaxslam.sensor.likelihood_field import LikelihoodField

Number = float | Float[Array, ""]

_WIDEST_START = 1e4


class StartSettings(eqx.Module):
    """How well a start that is given is known.

    Attributes:
        deviation: standard deviation of its x and of its y, meters.
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
        translation: side of a bin, meters.
        rotation: width of a bin, radians.
    """

    translation: Number = 0.5
    rotation: Number = math.pi / 18

    def __check_init__(self):
        require_at_least_zero(self, positive=("translation", "rotation"))


class LocalizationConfig(eqx.Module):
    """A whole localization and how it is fed. Floats are traced, sizes and choices static.

    Attributes:
        max_particles: N, room for particles; a global start fills it (static).
        max_distance: end points farther than this from any obstacle are all alike, meters.
        resample_below: resample where the effective sample size is under this share of the particles; over
            1 resamples in every step.
        min_valid_beams: a scan with fewer among those that are looked at moves the particles by odometry
            alone.
        lidar: ranges of the sensor; None: it is chosen by the scans of the log.
        thinning: which scans are processed (static: it decides how many steps there are).
        start: how well a start that is given is known.
        bins: to count where particles are.
        motion: p(x_t | x_{t−1}, u_t).
        sensor: p(z_t | x_t, m).
        skipping: of beams that hardly any particle explains.
        sampling: how many particles are needed.
        recovery: how many of them come from the whole map.
        clustering: where the estimate is.
        agreement: what counts as converged and as lost.
    """

    max_particles: int = eqx.field(static=True, default=100_000)
    max_distance: Number = 2.0
    resample_below: Number = 0.5
    min_valid_beams: Number = 5.0
    lidar: LidarSettings | None = eqx.field(default=None, metadata={UNSET: LidarSettings.from_preset("sick")})
    thinning: Thinning = eqx.field(static=True, default=Thinning())
    start: StartSettings = StartSettings()
    bins: BinSettings = BinSettings()
    motion: AbstractMotionModel = OdometryMotion()
    sensor: AbstractSensorModel = LikelihoodField(
        sigma_hit=0.2, unseen_beams=0.0, independent_beams=5.0, max_beams=60
    )
    skipping: BeamSkipping = BeamSkipping()
    sampling: KLDSampling = KLDSampling()
    recovery: Recovery = Recovery()
    clustering: Clustering = Clustering()
    agreement: Agreement = Agreement()

    def __check_init__(self):
        if self.max_particles < 1:
            raise ValueError(f"max_particles is {self.max_particles}: give 1 or more")
        require_at_least_zero(self, positive=("max_distance",))

    def with_lidar(self, preset: LidarPreset | str) -> "LocalizationConfig":
        """Return the configuration with the ranges of a lidar, given by preset or name of a preset."""
        return dataclasses.replace(self, lidar=LidarSettings.from_preset(preset))
