"""A method of a comparison, as a configuration."""

from dataclasses import dataclass, field
from typing import Any

from jaxslam.config.dotted import update
from jaxslam.config.lidar_presets import PRESETS
from jaxslam.config.slam import SlamConfig

ODOMETRY_NOISE: dict[str, Any] = {
    "motion.translation_floor": 0.005,
    "motion.rotation_floor": 0.01,
    "motion.rotation_noise_from_rotation": 0.01,
    "motion.rotation_noise_from_translation": 0.001,
    "motion.translation_noise_from_translation": 0.0004,
    "motion.translation_noise_from_rotation": 0.0004,
}
"""The simulated wheels' own noise. The defaults, which suit the worst of logs, would cost the traditional
filter a metre."""


@dataclass(frozen=True)
class Method:
    """A row of a table.

    Attributes:
        title: for people.
        method: of `jaxslam.config.slam.METHODS`.
        particles: how many.
        changes: settings that differ from the method's defaults.
        lidar: preset.
    """

    title: str
    method: str
    particles: int
    changes: dict[str, Any] = field(default_factory=dict)
    lidar: str = "sick"

    def configuration(self) -> SlamConfig:
        """The whole filter."""
        base = SlamConfig(num_particles=self.particles).with_lidar(PRESETS[self.lidar])
        chosen = update(base.with_method(self.method), ODOMETRY_NOISE, exact=True)
        return update(chosen, self.changes, exact=True)
