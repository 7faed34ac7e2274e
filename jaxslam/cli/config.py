"""`jaxslam config`."""

from dataclasses import dataclass
from typing import Any

from jaxslam.cli.common import Assignments, File, Lidar, Method, Particles, Switch


@dataclass(frozen=True)
class Config:
    """Print the configuration as TOML with a comment for each setting, for use with `run --config`."""

    lidar: Lidar = None
    """Lidar preset: sick, urg-04lx, rplidar-a1, lds-01, lds-02 or vlp-16."""
    method: Method = None
    """rbpf, gmapping, fruit-fly or gaussian, as for `jaxslam run`."""
    particles: Particles = None
    """Number of particles; each has its own map."""
    config: File = None
    """Configuration in TOML to start from."""
    set: Assignments = ()
    """Settings by name, for example sensor.sigma_hit=0.1; repeatable. They override all other sources."""
    localization: Switch = False
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
