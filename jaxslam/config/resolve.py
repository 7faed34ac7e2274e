"""Resolve a configuration from defaults, a lidar preset, a file, flags and assignments."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from jaxslam.config import toml
from jaxslam.config.dotted import parse_assignment, update
from jaxslam.config.lidar import LidarSettings
from jaxslam.config.lidar_presets import PRESETS, detect_lidar, lidar_preset
from jaxslam.config.localization import LocalizationConfig
from jaxslam.config.slam import SlamConfig
from jaxslam.io.log import SensorLog

AnyConfig = TypeVar("AnyConfig", SlamConfig, LocalizationConfig)

_FALLBACK = PRESETS["sick"]
"""Preset whose values apply if neither a name nor a log selects a lidar."""


def resolve_config(
    defaults: AnyConfig,
    *,
    log: SensorLog | None = None,
    config: Path | None = None,
    lidar: str | None = None,
    method: str | None = None,
    flags: Mapping[str, object] | None = None,
    assignments: Sequence[str] = (),
) -> AnyConfig:
    """Return the configuration for a command line; a later source overrides an earlier one.

    The sources are, in this order: the defaults, the lidar detected in the log (unless
    `lidar` or the file names one), the file, `lidar`, `method`, the flags, the assignments.

    Args:
        defaults: configuration of mapping or of localization to start from.
        log: log from whose scans the lidar is detected. Without a log, the lidar stays None unless another
            source sets it.
        config: TOML file, or None.
        lidar: name of a preset, or None.
        method: name from `METHODS`, or None. It applies to mapping only.
        flags: values by dotted name; None for a flag that was not given.
        assignments: texts `name=value`.

    Raises:
        ValueError: a name is unknown or a value is invalid; the message is one line.
        OSError: the file cannot be read.
    """
    preset = lidar_preset(lidar) if lidar is not None else None
    values = toml.read_settings(config) if config is not None else {}
    is_named = preset is not None or any(name.startswith("lidar.") for name in values)
    resolved = defaults.with_lidar(_FALLBACK if is_named or log is None else detect_lidar(log))
    if config is not None:
        resolved = toml.apply(config, values, resolved)
    if preset is not None:
        resolved = resolved.with_lidar(preset)
    if method is not None and isinstance(resolved, SlamConfig):
        resolved = resolved.with_method(method)
    given = {name: value for name, value in (flags or {}).items() if value is not None}
    resolved = update(resolved, given, exact=True)
    pairs = [parse_assignment(text) for text in assignments]
    names = [name for name, _ in pairs]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise ValueError(f"--set {twice} is given {names.count(twice)} times: give it once")
    resolved = update(resolved, dict(pairs))
    if log is None and not is_named and resolved.lidar == LidarSettings.from_preset(_FALLBACK):
        return replace(resolved, lidar=None)
    return resolved
