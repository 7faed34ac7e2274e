"""Settings for thinning: which scans of a log a filter processes."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Thinning:
    """Rule for which scans a filter processes: a scan is processed once the robot has moved or turned enough.

    Attributes:
        min_translation: Path length since the last processed scan after which the next scan is processed,
            meters.
        min_rotation: Total rotation since the last processed scan after which the next scan is processed,
            radians.
    """

    min_translation: float = 0.2
    min_rotation: float = 0.2

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not value >= 0:
                raise ValueError(f"thinning.{name} is {value}: give 0 or more")
