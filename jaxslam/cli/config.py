"""`jaxslam config`."""

from jaxslam.cli.arguments import Config
from jaxslam.config import toml
from jaxslam.config.lidar_presets import PRESETS
from jaxslam.config.localization import LocalizationConfig
from jaxslam.config.resolve import Whole, effective_configuration
from jaxslam.config.slam import SlamConfig


def execute(command: Config, arguments: list[str]) -> None:
    """Prints the effective configuration as TOML."""
    if not command.localization:
        _print(command, SlamConfig(), "num_particles")
    elif command.method is None:
        _print(command, LocalizationConfig(), "max_particles")
    else:
        raise ValueError("--method is of the filter that maps, and --localization of the one that localises")


def _print(command: Config, defaults: Whole, particles: str) -> None:
    configuration = effective_configuration(
        defaults,
        config=command.config,
        lidar=command.lidar,
        method=command.method,
        flags={particles: command.particles},
        assignments=command.set,
        detect=lambda: PRESETS["sick"],
    )
    untouched = configuration.lidar == defaults.lidar
    if command.lidar is None and command.config is None and untouched:
        print("# The lidar is left out: the log's scans choose. `jaxslam config --lidar NAME` has it.")
        print(toml.dumps(configuration, without="lidar"), end="")
    else:
        print(toml.dumps(configuration), end="")
