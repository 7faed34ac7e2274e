"""Settings of the lidar: its ranges and the timing of its beams."""

import equinox as eqx
from jaxtyping import Array, Float

from jaxslam.config.lidar_presets import LidarPreset, lidar_preset
from jaxslam.core.validation import require_number

Number = float | Float[Array, ""]


class LidarSettings(eqx.Module):
    """Ranges of the lidar and timing of its beams.

    Attributes:
        name: Name of the preset that the ranges come from (static).
        usable_range: Range beyond which a return only clears the space in front of it, meters.
        min_range: Shortest valid reading, meters. A shorter reading counts as no return.
        max_range: Upper limit of valid readings, meters. A reading at or above it counts as no return.
        turn_time: Duration of one revolution of the lidar, seconds. It is used for logs without the times of
            the beams; 0 treats all beams of a scan as simultaneous.
        max_lag: Largest offset between the stamps of scans and odometry that is searched and corrected,
            seconds; 0 keeps the stamps unchanged.
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
            raise ValueError(
                f"lidar.min_range is {low} m and lidar.max_range {high} m: give a min_range below max_range"
            )

    @classmethod
    def from_preset(cls, preset: LidarPreset | str) -> "LidarSettings":
        """Return the settings of a preset, given as an object or by name.

        Raises:
            ValueError: no preset has this name; the message suggests the closest match.
        """
        preset = lidar_preset(preset) if isinstance(preset, str) else preset
        return cls(preset.name, preset.usable_range, preset.min_range, preset.max_range, preset.turn_time)
