"""`jaxslam config`."""

from dataclasses import dataclass
from typing import Any

from jaxslam.cli import options


@dataclass(frozen=True)
class Config:
    """Flags of `jaxslam config`."""

    lidar: options.Lidar = None
    method: options.Method = None
    particles: options.Particles = None
    config: options.File = None
    """Configuration in TOML to start from."""
    set: options.Settings = ()
    localization: options.Switch = False
    """Print the settings of `localize` instead of those of `run`."""


def execute(command: Config, arguments: list[str]) -> None:
    """Print the effective configuration as TOML."""
    import jaxslam
    from jaxslam.config import toml
    from jaxslam.config.resolve import resolve_config

    if command.localization and command.method is not None:
        raise ValueError("--method applies to `run` only: leave it out with --localization")
    defaults: Any = jaxslam.LocalizationConfig() if command.localization else jaxslam.SlamConfig()
    particles = "max_particles" if command.localization else "num_particles"
    config: Any = resolve_config(
        defaults,
        config=command.config,
        lidar=command.lidar,
        method=command.method,
        flags={particles: command.particles},
        assignments=command.set,
    )
    if config.lidar is None:
        print("# No lidar is set: `jaxslam run` detects it from the scans of the log.")
        print("# `jaxslam config --lidar NAME` prints its settings.")
    print(toml.dumps(config), end="")
