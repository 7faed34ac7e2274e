"""The commands and their flags, as dataclasses that tyro turns into a parser.

Only what `--help` needs is imported here: neither JAX nor matplotlib.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import FlagCreatePairsOff, Positional, UseAppendAction, arg, subcommand

from jaxslam.cli.fetch import Fetch

_FROM_CONFIGURATION = "(default: from the configuration, see `jaxslam config`)"

LogPath = Annotated[Path, Positional, arg(metavar="LOG")]
Particles = Annotated[str | None, arg(metavar="N", help_behavior_hint=_FROM_CONFIGURATION)]
Margin = Annotated[str | None, arg(metavar="METRES", help_behavior_hint=_FROM_CONFIGURATION)]
LidarName = Annotated[
    str | None, arg(metavar="NAME", help_behavior_hint="(default: chosen by the log's scans)")
]
MethodName = Annotated[
    str | None, arg(metavar="rbpf|gmapping|fruit-fly|gaussian", help_behavior_hint="(default: gmapping)")
]
Assignments = Annotated[
    UseAppendAction[tuple[str, ...]], arg(metavar="NAME=VALUE", help_behavior_hint="(default: none)")
]
File = Annotated[Path | None, arg(metavar="FILE", help_behavior_hint="(default: none)")]
Topic = Annotated[str | None, arg(metavar="TOPIC", help_behavior_hint="(default: chosen)")]
Switch = FlagCreatePairsOff[bool]
RangeNetworkFile = Annotated[Path | None, arg(metavar="FILE", help_behavior_hint="(default: none)")]


@dataclass(frozen=True)
class Run:
    """Map a log: CARMEN (.log, .clf, also .gz), ROS 1 bag, ROS 2 bag (.mcap, .db3 or folder)."""

    log: LogPath
    """The log file, or the folder of a ROS 2 bag."""
    method: MethodName = None
    """rbpf moves the particles by odometry alone; gmapping matches every scan to every particle's map;
    fruit-fly aligns it by ICP and lets a swarm look for a better pose; gaussian draws around the match."""
    particles: Particles = None
    """Number of particles, each with a map of its own."""
    seed: int = 0
    """Seed of all random numbers, 0 to 4294967295: the same seed gives the same bytes."""
    relations: File = None
    """Known relations (t1 t2 x y z roll pitch yaw) to measure the trajectory with."""
    reference: File = None
    """Reference trajectory (TUM format, seconds and metres) to measure the ATE against."""
    config: File = None
    """Configuration in TOML, as `jaxslam config` prints it; it may name a few settings only."""
    set: Assignments = ()
    """Settings by name, such as sensor.sigma_hit=0.1, any number of them; they come last."""
    lidar: LidarName = None
    """Lidar preset: sick, urg-04lx, rplidar-a1, lds-01, lds-02 or vlp-16."""
    range_network: RangeNetworkFile = None
    """Correct every range by this network first, as `jaxslam train-range` writes it."""
    map_margin: Margin = None
    """Room around the odometry's path beyond the lidar's usable range, metres."""
    scan_topic: Topic = None
    """Of a bag: topic of the laser scans."""
    odom_topic: Topic = None
    """Of a bag: topic of the wheel odometry."""
    imu_topic: Topic = None
    """Of a bag: topic of the IMU."""
    fuse: Switch = False
    """Fuse the odometry with the log's IMU first; the fused covariance then moves the particles. With
    --method fruit-fly it is done wherever a log has an IMU, unless --set fusion.use=off."""
    imu_yaw_axis: Annotated[
        str | None, arg(metavar="x|y|z|-x|-y|-z", help_behavior_hint="(default: from the log, or gravity)")
    ] = None
    """Where odometry and IMU are fused: the IMU's axis that points up."""
    gif: Switch = False
    """Also write map.gif, the map as it is built."""
    out: Annotated[
        Path | None, arg(metavar="DIR", help_behavior_hint="(default: runs/<log>-<method>-s<seed>)")
    ] = None
    """Folder for the results; made if it is not there, overwritten file by file if it is."""


@dataclass(frozen=True)
class Demo:
    """Map a simulated hall and compare the result with the truth: needs no data."""

    out: Annotated[Path | None, arg(metavar="DIR", help_behavior_hint="(default: runs/demo-s<seed>)")] = None
    """Folder for the results; made if it is not there, overwritten file by file if it is."""
    world: Annotated[str, arg(metavar="NAME")] = "hall_small"
    """Which world: hall_small (18 × 15 m), hall_large (24 × 23 m), roadway (71 × 26 m, of a coal mine) or
    corridor_loop (43 × 16 m)."""
    duration: float = 200.0
    """Seconds driven; a tour of either hall takes nearly 200, one of the roadway 190, of the corridor 125."""
    seed: int = 0
    """Seed of the simulation and of the filter, 0 to 4294967295."""
    method: MethodName = None
    """rbpf, gmapping, fruit-fly or gaussian, as for `run`."""
    particles: Annotated[str, arg(metavar="N")] = "15"
    """Number of particles, each with a map of its own."""
    set: Assignments = ()
    """Settings by name, such as sensor.sigma_hit=0.1, any number of them; they come last."""
    range_network: RangeNetworkFile = None
    """Correct every range by this network first, as `jaxslam train-range` writes it."""
    gif: Switch = False
    """Also write map.gif, the map as it is built."""


@dataclass(frozen=True)
class Localize:
    """Find and follow the robot of a log on a map that is known, by adaptive Monte-Carlo localisation."""

    log: LogPath
    """The log file, or the folder of a ROS 2 bag."""
    map: Annotated[Path, arg(metavar="MAP.yaml")]
    """Map as map_server and nav2 keep it: a yaml file with an image beside it."""
    start: Annotated[str | None, arg(metavar="X,Y,THETA", help_behavior_hint="(default: none)")] = None
    """Where the robot is at first, in the map's frame: metres, metres, radians. How well that is known is
    start.deviation (0.5 m) and start.rotation_deviation (0.26 rad)."""
    global_: Annotated[Switch, arg(name="global")] = False
    """Not known: look for it in all free space."""
    seed: int = 0
    """Seed of all random numbers, 0 to 4294967295: the same seed gives the same bytes."""
    particles: Annotated[str | None, arg(metavar="N", help_behavior_hint="(default: 100000)")] = None
    """Largest number of particles: a global start has so many, and as few live as are needed."""
    reference: File = None
    """Reference trajectory in the map's frame (TUM format, seconds and metres), to measure the error with."""
    config: File = None
    """Configuration in TOML, as a localisation writes it; it may name a few settings only."""
    set: Assignments = ()
    """Settings by name, such as scan_model.sigma_hit=0.1, any number of them; they come last."""
    lidar: LidarName = None
    """Lidar preset: sick, urg-04lx, rplidar-a1, lds-01, lds-02 or vlp-16."""
    range_network: RangeNetworkFile = None
    """Correct every range by this network first, as `jaxslam train-range` writes it."""
    scan_topic: Topic = None
    """Of a bag: topic of the laser scans."""
    odom_topic: Topic = None
    """Of a bag: topic of the wheel odometry."""
    gif: Switch = False
    """Also write cloud.gif, the particles on the map."""
    out: Annotated[
        Path | None, arg(metavar="DIR", help_behavior_hint="(default: runs/<log>-amcl-s<seed>)")
    ] = None
    """Folder for the results; made if it is not there, overwritten file by file if it is."""


@dataclass(frozen=True)
class Info:
    """Say what is in a log: counts, rates, beams, ranges, path, gaps."""

    log: LogPath
    """The log file, or the folder of a ROS 2 bag."""
    scan_topic: Topic = None
    """Of a bag: topic of the laser scans."""
    odom_topic: Topic = None
    """Of a bag: topic of the wheel odometry."""
    imu_topic: Topic = None
    """Of a bag: topic of the IMU."""


@dataclass(frozen=True)
class Config:
    """Print the configuration as TOML, every setting with its unit: for a file to give to `run --config`."""

    lidar: LidarName = None
    """Lidar preset: sick, urg-04lx, rplidar-a1, lds-01, lds-02 or vlp-16."""
    method: MethodName = None
    """rbpf moves the particles by odometry alone; gmapping matches every scan to every particle's map;
    fruit-fly aligns it by ICP and lets a swarm look for a better pose; gaussian draws around the match."""
    particles: Particles = None
    """Number of particles, each with a map of its own."""
    config: File = None
    """Configuration in TOML to start from."""
    set: Assignments = ()
    """Settings by name, such as sensor.sigma_hit=0.1, any number of them; they come last."""
    localization: Switch = False
    """The settings of `localize` instead of those of `run`."""


@dataclass(frozen=True)
class Fuse:
    """Fuse wheel odometry and IMU of a log by a Kalman filter, and write the trajectory."""

    log: LogPath
    """The log file, or the folder of a ROS 2 bag."""
    out: Annotated[Path, arg(metavar="DIR")] = Path("runs/fuse")
    """Folder for the results; made if it is not there, overwritten file by file if it is."""
    imu_yaw_axis: Annotated[
        str | None, arg(metavar="x|y|z|-x|-y|-z", help_behavior_hint="(default: from the log, or gravity)")
    ] = None
    """The IMU's axis that points up."""
    gps: Switch = False
    """Compare with the log's GPS fixes, after the best rotation and shift."""
    wheel_radius: Annotated[float | None, arg(metavar="METRES", help_behavior_hint="(default: none)")] = None
    """Odometry from the wheels' angles (JointState) instead of the log's own; needs --track."""
    track: Annotated[float | None, arg(metavar="METRES", help_behavior_hint="(default: none)")] = None
    """Distance between the wheels, for --wheel-radius."""
    odometry_poses: Switch = False
    """Read the odometry's pose as well as its rates, as the paper has it."""
    imu_headings: Switch = False
    """Read the IMU's heading as well as its rate; it may be a compass beside iron."""
    world_frame: Switch = False
    """The linear filter, its velocities along the world's axes, as the paper has it."""
    odom_topic: Topic = None
    """Of a bag: topic of the wheel odometry."""
    imu_topic: Topic = None
    """Of a bag: topic of the IMU."""


@dataclass(frozen=True)
class TrainRange:
    """Train a network that corrects a lidar's ranges, on readings of a wall at known distances."""

    data: Annotated[tuple[str, ...], Positional, arg(metavar="DATA")]
    """Tables (FILE.csv with the columns true_m and measured_m) or logs of a robot that faces a wall, each
    with the distance of the wall from the lidar in metres (wall.mcap:1.5); any number of them."""
    out: Annotated[Path, arg(metavar="FILE")] = Path("network.eqx")
    """The network; the error table and the figures go to a folder beside it, <name>-training."""
    neurons: Annotated[tuple[int, ...], arg(metavar="N [N …]")] = (50,)
    """Neurons of the hidden layer; of several sizes the one that validates best is kept."""
    restarts: Annotated[int, arg(metavar="N")] = 5
    """Trainings per size, each from another start; the one that validates best is kept."""
    held_out: Annotated[
        tuple[float, ...],
        arg(metavar="METRES [METRES …]", help_behavior_hint="(default: every fifth of 10 or more)"),
    ] = ()
    """Distances that nothing is learnt from, to judge the network by."""
    method: Literal["levenberg-marquardt", "adam"] = "levenberg-marquardt"
    """What trains it: adam is slower, and here for comparison."""
    bearing: Annotated[float, arg(metavar="RAD")] = 0.0
    """Of a log: bearing of the beam that faces the wall, in the lidar's frame, radians."""
    seed: int = 0
    """Seed of the starts, 0 to 4294967295."""


@dataclass(frozen=True)
class Study:
    """Look for better settings by many runs, as a file describes it; `study report STORAGE` tells results."""

    plan: Annotated[Path, Positional, arg(metavar="CONFIG.toml")]
    """What is tuned on which logs; notebooks/06_study.ipynb and the README show one."""
    trials: Annotated[int | None, arg(metavar="N", help_behavior_hint="(default: of the file, else 50)")] = (
        None
    )
    """Trials in all, those that the storage has already included."""
    storage: Annotated[str | None, arg(metavar="URL", help_behavior_hint="(default: runs/<name>.db)")] = None
    """A SQLite file, or the URL of a database; a study that was broken off goes on from there."""
    cluster: Annotated[str | None, arg(metavar="ADDRESS", help_behavior_hint="(default: this process)")] = (
        None
    )
    """Run the trials on a Dask cluster: its scheduler's address (tcp://host:8786), or local:N processes."""
    out: Annotated[Path | None, arg(metavar="DIR", help_behavior_hint="(default: runs/<name>-study)")] = None
    """Folder for the report; made if it is not there, overwritten file by file if it is."""


@dataclass(frozen=True)
class StudyReport:
    """Tables and pictures of a study, finished or not, and its best configuration."""

    storage: Annotated[str, Positional, arg(metavar="STORAGE")]
    """The SQLite file, or the URL of a database, that has the study."""
    name: Annotated[str | None, arg(metavar="NAME", help_behavior_hint="(default: the only one)")] = None
    """Which study, if the storage has several."""
    out: Annotated[Path | None, arg(metavar="DIR", help_behavior_hint="(default: runs/<name>-study)")] = None
    """Folder for the report; made if it is not there, overwritten file by file if it is."""


Command = (
    Annotated[Run, subcommand("run")]
    | Annotated[Demo, subcommand("demo")]
    | Annotated[Localize, subcommand("localize")]
    | Annotated[Info, subcommand("info")]
    | Annotated[Config, subcommand("config")]
    | Annotated[Fuse, subcommand("fuse")]
    | Annotated[TrainRange, subcommand("train-range")]
    | Annotated[Study, subcommand("study")]
    | Annotated[StudyReport, subcommand("study-report")]
    | Annotated[Fetch, subcommand("fetch")]
)
