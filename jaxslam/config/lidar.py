"""The lidar of a configuration: its ranges and when its beams are taken."""

import equinox as eqx
from jaxtyping import Array, Float

from jaxslam.config.lidar_presets import LidarPreset, lidar_preset
from jaxslam.core.validation import require_number

Number = float | Float[Array, ""]


class LidarSettings(eqx.Module):
    """The ranges of the lidar, and when its beams are taken.

    Attributes:
        name: the preset they are from (static).
        usable_range: longer returns only clear the space before them, meters.
        min_range: shorter readings are no return, meters.
        max_range: readings at or over it are no return, meters.
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
        require_number(self, "usable_range", lambda value: value > 0, "a number of meters above 0")
        require_number(self, "min_range", lambda value: value >= 0, "a number of meters, 0 or more")
        require_number(self, "max_range", lambda value: value > 0, "a number of meters above 0")
        require_number(self, "turn_time", lambda value: value >= 0, "a number of seconds, 0 or more")
        require_number(self, "max_lag", lambda value: value >= 0, "a number of seconds, 0 or more")
        low, high = self.min_range, self.max_range
        if isinstance(low, float) and isinstance(high, float) and not low < high:
            raise ValueError(f"lidar.min_range is {low} m and lidar.max_range {high} m: exchange them")

    @classmethod
    def from_preset(cls, preset: LidarPreset | str) -> "LidarSettings":
        """Return the settings of a preset, given itself or by name.

        Raises:
            ValueError: there is no preset of that name; the message names the nearest.
        """
        preset = lidar_preset(preset) if isinstance(preset, str) else preset
        return cls(preset.name, preset.usable_range, preset.min_range, preset.max_range, preset.turn_time)
