"""The configuration of a localization: everything except the log, the map, the start pose and the seed."""

import dataclasses
import math
from collections.abc import Mapping

import equinox as eqx

from jaxslam.config.dotted import UNSET, update
from jaxslam.config.lidar import LidarSettings, Number
from jaxslam.config.lidar_presets import LidarPreset
from jaxslam.config.thinning import Thinning
from jaxslam.core.validation import require_at_least_zero, require_count
from jaxslam.localization import Agreement, Clustering, KLDSampling, Recovery
from jaxslam.localization.skipping import BeamSkipping
from jaxslam.motion import AbstractMotionModel, OdometryMotion
from jaxslam.sensor.base import AbstractSensorModel
from jaxslam.sensor.likelihood_field import LikelihoodField

_WIDEST_START = 1e4
"""Largest standard deviation of a start pose, meters or radians."""


class StartSettings(eqx.Module):
    """Uncertainty of a given start pose.

    Attributes:
        deviation: Standard deviation of the start position in x and in y, meters.
        rotation_deviation: Standard deviation of the start heading, radians.
    """

    deviation: Number = 0.5
    rotation_deviation: Number = 0.26

    def __check_init__(self):
        require_at_least_zero(self)
        for name in ("deviation", "rotation_deviation"):
            value = getattr(self, name)
            if isinstance(value, float) and value > _WIDEST_START:
                raise ValueError(
                    f"start.{name} is {value:g}: give at most {_WIDEST_START:g}, or search the whole map "
                    "with --global"
                )


class BinSettings(eqx.Module):
    """Histogram bins over poses; KLD sampling counts the occupied bins to measure the particles' spread.

    Attributes:
        translation: Size of a bin in x and in y, meters.
        rotation: Size of a bin in heading, radians.
    """

    translation: Number = 0.5
    rotation: Number = math.pi / 18

    def __check_init__(self):
        require_at_least_zero(self, positive=("translation", "rotation"))


class LocalizationConfig(eqx.Module):
    """Configuration of a localization. Floats are traced; sizes and choices are static.

    Attributes:
        max_particles: Largest number of particles, N. A global start uses all of them (static).
        max_distance: Largest distance to an obstacle that the sensor model distinguishes, meters. End points
            farther from any obstacle all score alike.
        resample_below: Effective sample size below which the particles are resampled, as a fraction of their
            number. A value above 1 resamples at every step.
        min_valid_beams: Smallest number of valid beams, among the scored beams, for which a scan is used.
            With fewer, odometry alone moves the particles.
        lidar: Ranges of the lidar. None detects the preset from the scans of the log.
        thinning: Rule for which scans are processed (static, because it determines the number of steps).
        start: Uncertainty of a given start pose.
        bins: Bins over poses for KLD sampling.
        motion: Motion model, p(x_t | x_{t−1}, u_t).
        sensor: Sensor model, p(z_t | x_t, m).
        skipping: Rule for skipping beams that hardly any particle explains.
        sampling: KLD sampling, which adapts the number of particles.
        recovery: Rule for adding particles drawn from the whole map.
        clustering: Clustering of the particles, which yields the estimate.
        agreement: Criteria for a converged and for a lost localization.
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
        require_count(self, "max_particles")
        require_at_least_zero(self, positive=("max_distance",))

    def with_lidar(self, preset: LidarPreset | str) -> "LocalizationConfig":
        """Return a copy with the ranges of a lidar preset, given as an object or by name."""
        return dataclasses.replace(self, lidar=LidarSettings.from_preset(preset))

    def with_settings(self, settings: Mapping[str, object]) -> "LocalizationConfig":
        """Return a copy with settings changed by name, as `SlamConfig.with_settings` does."""
        return update(self, settings)
