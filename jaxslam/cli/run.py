"""`jaxslam run LOG`."""

import dataclasses
import shlex

from jaxslam.cli.arguments import Run
from jaxslam.cli.common import (
    check_seed,
    map_log,
    network_origin,
    print_summary,
    read_network,
    read_reference,
    warn,
    warn_if_assumed,
    warn_if_unmounted,
)
from jaxslam.config.lidar_presets import detect_lidar
from jaxslam.config.resolve import effective_configuration
from jaxslam.config.slam import SlamConfig
from jaxslam.io import SensorLog, read_log, read_relations
from jaxslam.pipeline.prepare import prepare
from jaxslam.pipeline.run import RunResult
from jaxslam.report import (
    default_folder,
    file_sha256,
    make_folder,
    reference_error,
    relation_figures,
    trajectory_figures,
    versions,
    write_run,
)

_FEW_RELATIONS = 0.9
"""A log that holds a smaller share of the relations may be another one, or a part."""


def execute(command: Run, arguments: list[str]) -> None:
    """Maps a log and writes its run folder."""
    check_seed(command.seed)
    network = read_network(command.range_network)
    log = _read(command)
    configuration = effective_configuration(
        SlamConfig(),
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
        detect=lambda: detect_lidar(log),
    )
    if command.imu_yaw_axis is not None and configuration.fusion.use == "off":
        raise ValueError("--imu-yaw-axis is for --fuse, which was not given")
    prepared = prepare(log, configuration, network)
    if prepared.yaw is not None:
        warn_if_assumed(prepared.yaw)
    # Everything that can be wrong is read before the filter spends its minutes.
    measure = _measures(command, log)
    folder = command.out or default_folder(command.log, configuration.method, command.seed)
    make_folder(folder)
    result = map_log(prepared, command.seed, gif=folder / "map.gif" if command.gif else None)
    scans_in = 0 if log.scans is None else len(log.scans.stamps)
    fused, timing = prepared.fused, prepared.timing
    metrics = write_run(
        folder,
        result,
        configuration,
        seed=command.seed,
        scans_in=scans_in,
        origin={
            "command": shlex.join(["jaxslam", *arguments]),
            "log": {"path": str(command.log.resolve()), "sha256": file_sha256(command.log)},
            "range_network": network_origin(command.range_network),
            "versions": versions(),
            "fused": None if fused is None else {"readings": fused.readings, "refused": fused.refused},
            "scan_timing": None if timing is None else dataclasses.asdict(timing),
        },
        accuracy=measure(result),
    )
    chosen = "given" if command.lidar or command.config else "chosen by the log's scans"
    lidar = f"{configuration.lidar.name} ({chosen})"
    print_summary(folder, result, configuration, metrics, lidar, prepared)


def _read(command: Run) -> SensorLog:
    log = read_log(
        command.log,
        scan_topic=command.scan_topic,
        odometry_topic=command.odom_topic,
        imu_topic=command.imu_topic,
    )
    warn(log.warnings)
    warn_if_unmounted(log)
    return log


def _measures(command: Run, log: SensorLog):
    """A function from the result to its errors, with the files read already."""
    relations = read_relations(command.relations) if command.relations is not None else None
    reference = read_reference(command.reference, log) if command.reference is not None else None

    def measure(result: RunResult) -> dict[str, object]:
        assert log.odometry is not None  # `prepare_inputs` has looked
        errors: dict[str, object] = {}
        if relations is not None:
            figures = relation_figures(result.all_stamps, result.all_poses, log.odometry, relations)
            errors["relations"] = figures
            total = len(relations.stamps_from)
            if figures["n"] < _FEW_RELATIONS * total:
                used = f"only {figures['n']:.0f} of the {total} relations lie within the log"
                warn([f"{used}: are they its own?"])
        if reference is not None:
            error = reference_error(*reference, result.all_stamps, result.all_poses, log.odometry)
            errors["ate"] = trajectory_figures(error)
        return errors

    return measure
