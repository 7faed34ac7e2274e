"""`jaxslam run LOG`."""

import dataclasses
import shlex
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from jaxslam.cli.common import (
    Assignments,
    File,
    Lidar,
    LogPath,
    Method,
    Particles,
    Switch,
    Topic,
    YawAxis,
    check_seed,
    map_log,
    origin_of,
    print_run_summary,
    read_log,
    read_network,
    read_reference,
    warn,
    warn_if_assumed,
)

if TYPE_CHECKING:
    from jaxslam.io import SensorLog
    from jaxslam.pipeline.run import RunResult

_FEW_RELATIONS = 0.9
"""Fraction of the relations within the log below which the log may be the wrong one."""


@dataclass(frozen=True)
class Run:
    """Map a log: CARMEN (.log, .clf, also .gz), ROS 1 bag, ROS 2 bag (.mcap, .db3 or folder)."""

    log: LogPath
    """The log file, or the folder of a ROS 2 bag."""
    method: Method = None
    """rbpf: odometry alone moves the particles. gmapping: each scan is matched to each particle's map.
    fruit-fly: ICP, then a fruit-fly swarm, refine each pose. gaussian: poses are drawn from a Gaussian
    around the match."""
    particles: Particles = None
    """Number of particles; each has its own map."""
    seed: int = 0
    """Random seed, 0 to 4294967295. The same seed gives the same bytes."""
    relations: File = None
    """Ground-truth relations (t1 t2 x y z roll pitch yaw) to measure the trajectory with."""
    reference: File = None
    """Reference trajectory (TUM format, seconds and meters) to measure the trajectory error against."""
    config: File = None
    """Configuration in TOML, as `jaxslam config` prints it. It may contain any subset of the settings."""
    set: Assignments = ()
    """Settings by name, for example sensor.sigma_hit=0.1; repeatable. They override all other sources."""
    lidar: Lidar = None
    """Lidar preset: sick, urg-04lx, rplidar-a1, lds-01, lds-02 or vlp-16."""
    range_network: File = None
    """Correct all ranges with this network, written by `jaxslam train-range`."""
    map_margin: Annotated[
        float | None,
        arg(metavar="METERS", help_behavior_hint="(default: from the configuration, see `jaxslam config`)"),
    ] = None
    """Map margin around the odometry path, beyond the lidar's usable range, meters."""
    scan_topic: Topic = None
    """Laser-scan topic (ROS bags only)."""
    odom_topic: Topic = None
    """Wheel-odometry topic (ROS bags only)."""
    imu_topic: Topic = None
    """IMU topic (ROS bags only)."""
    fuse: Switch = False
    """Fuse odometry and IMU with a Kalman filter before mapping. With --method fruit-fly this is the default
    for logs with an IMU; --set fusion.use=off turns it off."""
    imu_yaw_axis: YawAxis = None
    """IMU axis that points up, where odometry and IMU are fused."""
    gif: Switch = False
    """Also write map.gif, an animation of the growing map."""
    out: Annotated[
        Path | None, arg(metavar="DIR", help_behavior_hint="(default: runs/<log>-<method>-s<seed>)")
    ] = None
    """Output folder. It is created if needed; existing files in it are overwritten."""


def execute(command: Run, arguments: list[str]) -> None:
    """Map a log and write its run folder."""
    import jaxslam
    from jaxslam.config.resolve import resolve_config
    from jaxslam.report import default_folder, make_folder, write_run

    check_seed(command.seed)
    network = read_network(command.range_network)
    log = read_log(
        command.log,
        scan_topic=command.scan_topic,
        odom_topic=command.odom_topic,
        imu_topic=command.imu_topic,
    )
    config = resolve_config(
        jaxslam.SlamConfig(),
        log=log,
        config=command.config,
        lidar=command.lidar,
        method=command.method,
        flags={
            "num_particles": command.particles,
            "map.margin": command.map_margin,
            "fusion.use": "on" if command.fuse else None,
            "fusion.yaw_axis": command.imu_yaw_axis,
        },
        assignments=command.set,
    )
    if command.imu_yaw_axis is not None and config.fusion.use == "off":
        raise ValueError("--imu-yaw-axis has no effect without fusion: give --fuse too")
    slam, scans = jaxslam.prepare(log, config, range_network=network)
    if scans.yaw is not None:
        warn_if_assumed(scans.yaw)
    # Read and check all inputs before the filter runs for minutes.
    measure = _measures(command, log)
    folder = command.out or default_folder(command.log, config.method, command.seed)
    make_folder(folder)
    result = map_log(slam, scans, command.seed, gif=folder / "map.gif" if command.gif else None)
    origin = origin_of(arguments, command.seed, log=command.log, range_network=command.range_network)
    fused, timing = scans.fused, scans.timing
    origin["fused"] = None if fused is None else {"readings": fused.readings, "refused": fused.refused}
    origin["scan_timing"] = None if timing is None else dataclasses.asdict(timing)
    metrics = write_run(folder, result, origin=origin, accuracy=measure(result))
    chosen = "given" if command.lidar or command.config else "chosen by the scans of the log"
    assert config.lidar is not None  # `resolve_config` has set it
    log_name, map_name = shlex.quote(str(command.log)), shlex.quote(str(folder / "map.yaml"))
    steps = [
        f"jaxslam localize {log_name} --map {map_name} --global",
        f"jaxslam run {log_name} --seed {command.seed + 1}   (results vary between seeds)",
    ]
    print_run_summary(folder, result, metrics, f"{config.lidar.name} ({chosen})", steps)


def _measures(command: Run, log: "SensorLog") -> "Callable[[RunResult], dict[str, object]]":
    """Read the reference files, and return a function from the result to its errors."""
    from jaxslam.io import read_relations
    from jaxslam.report import reference_error, relation_figures, trajectory_figures

    relations = read_relations(command.relations) if command.relations is not None else None
    reference = read_reference(command.reference, log) if command.reference is not None else None

    def measure(result: "RunResult") -> dict[str, object]:
        assert log.odometry is not None  # `prepare` has checked it
        errors: dict[str, object] = {}
        if relations is not None:
            figures = relation_figures(result.all_stamps, result.all_poses, log.odometry, relations)
            errors["relations"] = figures
            total = len(relations.stamps_from)
            if figures["n"] < _FEW_RELATIONS * total:
                used = f"only {figures['n']:.0f} of the {total} relations lie within the log"
                warn([f"{used}: do they belong to another log?"])
        if reference is not None:
            error = reference_error(*reference, result.all_stamps, result.all_poses, log.odometry)
            errors["ate"] = trajectory_figures(error)
        return errors

    return measure
