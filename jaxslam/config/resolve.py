"""From defaults, presets, a file and flags to one configuration."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

from jaxslam.config import toml
from jaxslam.config.dotted import parse_assignment, parse_scalar, update
from jaxslam.config.lidar_presets import LidarPreset, lidar_preset
from jaxslam.config.localization import LocalizationConfig
from jaxslam.config.slam import SlamConfig

Whole = TypeVar("Whole", SlamConfig, LocalizationConfig)


def effective_configuration(
    defaults: Whole,
    *,
    config: Path | None,
    lidar: str | None,
    flags: Mapping[str, str | None],
    assignments: Sequence[str],
    detect: Callable[[], LidarPreset],
    method: str | None = None,
) -> Whole:
    """The configuration that a command line asks for; what comes later wins.

    Defaults, the lidar that `detect` finds (unless `lidar` or the file names one), the file, `lidar`,
    `method`, the flags, the assignments.

    Args:
        defaults: of a filter or of a localisation.
        config: TOML file, or None.
        lidar: name of a preset, or None.
        flags: setting by flag, as text; None where the flag was not given.
        assignments: `name=value` each.
        detect: looks at the log; called only if its answer is used.
        method: of `METHODS`, or None; a localisation has none.

    Raises:
        ValueError: an unknown name or a wrong value, one line.
        OSError: the file cannot be read.
    """
    preset = lidar_preset(lidar) if lidar is not None else None
    configuration = defaults
    values = toml.read_settings(config) if config is not None else {}
    if preset is None and not any(name.startswith("lidar.") for name in values):
        configuration = configuration.with_lidar(detect())
    if config is not None:
        configuration = toml.apply(config, values, configuration)
    if preset is not None:
        configuration = configuration.with_lidar(preset)
    if method is not None and isinstance(configuration, SlamConfig):
        configuration = configuration.with_method(method)
    given = {name: parse_scalar(text) for name, text in flags.items() if text is not None}
    configuration = update(configuration, given, exact=True)
    pairs = [parse_assignment(text) for text in assignments]
    names = [name for name, _ in pairs]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise ValueError(f"--set {twice} is given {names.count(twice)} times: give it once")
    return update(configuration, dict(pairs))
