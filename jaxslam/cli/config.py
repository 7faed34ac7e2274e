"""`jaxslam config`."""

from jaxslam import toml
from jaxslam.cli.arguments import Config
from jaxslam.cli.effective import effective_configuration
from jaxslam.presets import PRESETS


def execute(command: Config, arguments: list[str]) -> None:
    """Prints the effective configuration as TOML."""
    configuration = effective_configuration(
        config=command.config,
        lidar=command.lidar,
        method=command.method,
        flags={"num_particles": command.particles},
        assignments=command.set,
        detect=lambda: PRESETS["sick"],
    )
    print(toml.dumps(configuration), end="")
