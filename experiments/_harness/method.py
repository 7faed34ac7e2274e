"""A method of a comparison, as a configuration."""

from dataclasses import dataclass, field
from typing import Any

from jaxslam import SlamConfig
from jaxslam.config.dotted import update

ODOMETRY_NOISE: dict[str, Any] = {
    "motion.translation_floor": 0.005,
    "motion.rotation_floor": 0.01,
    "motion.rotation_noise_from_rotation": 0.01,
    "motion.rotation_noise_from_translation": 0.001,
    "motion.translation_noise_from_translation": 0.0004,
    "motion.translation_noise_from_rotation": 0.0004,
}
"""Odometry noise set for the simulated wheels. The library's defaults suit the worst real logs; with them,
the error of the traditional filter would grow by a meter."""


@dataclass(frozen=True)
class Method:
    """A row of a table.

    Attributes:
        title: name in tables and figures.
        method: key of `jaxslam.config.slam.METHODS`.
        particles: number of particles.
        changes: settings that differ from the method's defaults.
        lidar: name of a lidar preset.
    """

    title: str
    method: str
    particles: int
    changes: dict[str, Any] = field(default_factory=dict)
    lidar: str = "sick"

    def configuration(self) -> SlamConfig:
        """Return the configuration of the filter."""
        base = SlamConfig(num_particles=self.particles).with_lidar(self.lidar)
        chosen = update(base.with_method(self.method), ODOMETRY_NOISE, exact=True)
        return update(chosen, self.changes, exact=True)
