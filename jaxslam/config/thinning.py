"""Which scans of a log a filter processes."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Thinning:
    """Which scans a filter processes: those taken after the robot has moved enough.

    Attributes:
        min_translation: path length since the last processed scan that makes the next one due, meters.
        min_rotation: or the sum of turning, radians.
    """

    min_translation: float = 0.2
    min_rotation: float = 0.2

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not value >= 0:
                raise ValueError(f"thinning.{name} is {value}: give 0 or more")
