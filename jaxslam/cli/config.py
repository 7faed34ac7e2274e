"""`jaxslam config`."""

from jaxslam import toml
from jaxslam.cli.arguments import Config
from jaxslam.cli.effective import effective_configuration
from jaxslam.configuration import Configuration
from jaxslam.presets import PRESETS


def execute(command: Config, arguments: list[str]) -> None:
    """Prints the effective configuration as TOML."""
    configuration = effective_configuration(
        Configuration(),
        config=command.config,
        lidar=command.lidar,
        method=command.method,
        flags={"num_particles": command.particles},
        assignments=command.set,
        detect=lambda: PRESETS["sick"],
    )
    untouched = configuration.lidar == Configuration().lidar
    if command.lidar is None and command.config is None and untouched:
        print("# The lidar is left out: the log's scans choose. `jaxslam config --lidar NAME` has it.")
        print(toml.dumps(configuration, without="lidar"), end="")
    else:
        print(toml.dumps(configuration), end="")
