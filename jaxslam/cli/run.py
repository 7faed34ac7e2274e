"""`jaxslam run LOG`."""

import dataclasses
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from jaxslam.cli import common, options

if TYPE_CHECKING:
    from jaxslam.core.trajectory import Trajectory
    from jaxslam.io import Relations
    from jaxslam.pipeline.run import RunResult

_FEW_RELATIONS = 0.9
"""Fraction of the relations within the log below which the log may be the wrong one."""


@dataclass(frozen=True)
class Run:
    """Flags of `jaxslam run`."""

    log: options.Log
    method: options.Method = None
    particles: options.Particles = None
    seed: options.Seed = 0
    relations: options.File = None
    """Ground-truth relations (t1 t2 x y z roll pitch yaw) to measure the trajectory with."""
    reference: options.File = None
    """Reference trajectory (TUM format, seconds and meters) to measure the trajectory error against, and
    to draw on the map."""
    config: options.File = None
    """Configuration in TOML, as `jaxslam config` prints it. It may contain any subset of the settings."""
    set: options.Settings = ()
    lidar: options.Lidar = None
    range_network: options.RangeNetwork = None
    map_margin: Annotated[float | None, options.optional("METERS", options.FROM_CONFIG)] = None
    """Map margin around the odometry path, beyond the lidar's usable range, meters."""
    scan_topic: options.ScanTopic = None
    odom_topic: options.OdomTopic = None
    imu_topic: options.ImuTopic = None
    fuse: options.Switch = False
    """Fuse odometry and IMU with a Kalman filter before mapping. With --method fruit-fly this is the default
    for logs with an IMU; --set fusion.use=off turns it off."""
    imu_yaw_axis: options.YawAxis = None
    gif: options.MapAnimation = False
    out: Annotated[Path | None, options.optional("DIR", "runs/<log>-<method>-s<seed>", options.FOLDER)] = None


def execute(command: Run, arguments: list[str]) -> None:
    """Map a log and write its run folder."""
    import jaxslam
    from jaxslam.config.resolve import resolve_config
    from jaxslam.io import read_relations
    from jaxslam.metrics.summary import reference_path
    from jaxslam.report import default_folder, make_folder, write_run

    network = common.read_network(command.range_network)
    log = common.read_log(
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
        common.warn_if_assumed(scans.yaw)
    # Read and check all inputs before the filter runs for minutes.
    relations = read_relations(command.relations) if command.relations is not None else None
    reference = common.read_reference(command.reference, log)
    folder = command.out or default_folder(command.log, config.method, command.seed)
    make_folder(folder)
    result = common.map_log(slam, scans, command.seed, gif=folder / "map.gif" if command.gif else None)
    origin = common.origin_of(arguments, command.seed, log=command.log, range_network=command.range_network)
    fused, timing = scans.fused, scans.timing
    origin["fused"] = None if fused is None else {"readings": fused.readings, "refused": fused.refused}
    origin["scan_timing"] = None if timing is None else dataclasses.asdict(timing)
    accuracy = _accuracy(result, relations, reference)
    path = None if reference is None else reference_path(reference, scans, result.all_poses)
    metrics = write_run(folder, result, origin=origin, accuracy=accuracy, truth=path)
    chosen = "given" if command.lidar or command.config else "chosen by the scans of the log"
    assert config.lidar is not None  # `resolve_config` has set it
    log_name, map_name = shlex.quote(str(command.log)), shlex.quote(str(folder / "map.yaml"))
    steps = [
        f"jaxslam localize {log_name} --map {map_name} --global",
        f"jaxslam run {log_name} --seed {command.seed + 1}   (results vary between seeds)",
    ]
    common.print_run_summary(folder, result, metrics, f"{config.lidar.name} ({chosen})", steps)


def _accuracy(
    result: "RunResult", relations: "Relations | None", reference: "Trajectory | None"
) -> dict[str, object]:
    """Return the errors of a run for `metrics.json`; empty without a ground truth."""
    from jaxslam.report import relation_figures, trajectory_figures

    errors: dict[str, object] = {}
    if relations is not None:
        errors["relations"] = figures = relation_figures(relations, result.scans, result.all_poses)
        total = len(relations.stamps_from)
        if figures["n"] < _FEW_RELATIONS * total:
            used = f"only {figures['n']:.0f} of the {total} relations lie within the log"
            common.warn(f"{used}: do they belong to another log?")
    if reference is not None:
        errors["ate"] = trajectory_figures(result.error(reference))
    return errors
