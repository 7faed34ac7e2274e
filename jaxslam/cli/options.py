"""Flags that several commands share."""

from pathlib import Path
from typing import Annotated, Any

from tyro.conf import FlagCreatePairsOff, Positional, UseAppendAction, arg


def optional(metavar: str, default: str, help: str | None = None) -> Any:
    """Describe a flag that may be left out; without `help`, the docstring of the field is its help."""
    return arg(metavar=metavar, help_behavior_hint=f"(default: {default})", help=help)


FOLDER = "Output folder. It is created if needed; existing files in it are overwritten."
FROM_CONFIG = "from the configuration, see `jaxslam config`"

Switch = FlagCreatePairsOff[bool]
File = Annotated[Path | None, optional("FILE", "none")]
Log = Annotated[Path, Positional, arg(metavar="LOG", help="The log file, or the folder of a ROS 2 bag.")]
ScanTopic = Annotated[str | None, optional("TOPIC", "auto-detected", "Laser-scan topic (ROS bags only).")]
OdomTopic = Annotated[str | None, optional("TOPIC", "auto-detected", "Wheel-odometry topic (ROS bags only).")]
ImuTopic = Annotated[str | None, optional("TOPIC", "auto-detected", "IMU topic (ROS bags only).")]
YawAxis = Annotated[
    str | None,
    optional("x|y|z|-x|-y|-z", "from the log, or from gravity", "IMU axis that points up, for the fusion."),
]
Seed = Annotated[int, arg(help="Random seed, 0 to 4294967295. The same seed gives the same bytes.")]
# Names are checked by the configuration, whose errors suggest the nearest name.
Method = Annotated[
    str | None,
    optional(
        "rbpf|gmapping|fruit-fly|gaussian",
        "gmapping",
        "rbpf: odometry alone moves the particles. gmapping: each scan is matched to each particle's map. "
        "fruit-fly: ICP, then a fruit-fly swarm, refine each pose. gaussian: poses are drawn from a Gaussian "
        "around the match.",
    ),
]
Lidar = Annotated[
    str | None,
    optional(
        "NAME",
        "chosen by the scans of the log",
        "Lidar preset: sick, urg-04lx, rplidar-a1, lds-01, lds-02 or vlp-16.",
    ),
]
Particles = Annotated[int | None, optional("N", FROM_CONFIG, "Number of particles; each has its own map.")]
Settings = Annotated[
    UseAppendAction[tuple[str, ...]],
    optional(
        "NAME=VALUE",
        "none",
        "Settings by name, for example sensor.sigma_hit=0.1; repeatable. They override all other sources.",
    ),
]
RangeNetwork = Annotated[
    Path | None,
    optional("FILE", "none", "Correct all ranges with this network, written by `jaxslam train-range`."),
]
MapAnimation = Annotated[Switch, arg(help="Also write map.gif, an animation of the growing map.")]
