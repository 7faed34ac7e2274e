"""`jaxslam localize LOG --map MAP.yaml`."""

import shlex
import sys
from pathlib import Path

import jax
import numpy as np

from jaxslam.cli.arguments import Localize
from jaxslam.cli.common import (
    check_seed,
    network_origin,
    read_network,
    read_reference,
    warn,
    warn_if_unmounted,
)
from jaxslam.config.lidar_presets import detect_lidar
from jaxslam.config.localization import LocalizationConfig
from jaxslam.config.resolve import effective_configuration
from jaxslam.io import OccupancyMap, SensorLog, read_log, read_map
from jaxslam.localization import AMCL
from jaxslam.localization.start import start_at
from jaxslam.metrics import TrajectoryError
from jaxslam.pipeline.build import build_localizer, require_memory
from jaxslam.pipeline.inputs import prepare_inputs
from jaxslam.pipeline.localize import Cloud, LocalizationResult, localize_log
from jaxslam.preprocess.ranges import correct_scans
from jaxslam.report import default_folder, file_sha256, make_folder, reference_error, versions
from jaxslam.report.localization import animate_clouds, write_localization

_FAR = 1e5
"""Single precision tells apart a centimetre up to here, metres."""


def execute(command: Localize, arguments: list[str]) -> None:
    """Localises a log in a map and writes its run folder."""
    check_seed(command.seed)
    start = _start(command)
    network = read_network(command.range_network)
    occupancy = read_map(command.map)
    log = read_log(command.log, scan_topic=command.scan_topic, odometry_topic=command.odom_topic)
    warn(log.warnings)
    warn_if_unmounted(log)
    reference = read_reference(command.reference, log) if command.reference is not None else None
    configuration = effective_configuration(
        LocalizationConfig(),
        config=command.config,
        lidar=command.lidar,
        flags={"max_particles": command.particles},
        assignments=command.set,
        detect=lambda: detect_lidar(log),
    )
    require_memory(configuration)
    try:
        amcl = build_localizer(configuration, occupancy, network)
    except ValueError as error:
        raise ValueError(f"{command.map}: {error}") from None
    _warn_if_far(command.map, occupancy)
    corrected, _ = correct_scans(log, configuration.lidar)
    prepared = prepare_inputs(corrected, configuration.thinning)
    key = jax.random.key(command.seed)
    # Not one of those of the steps, which count from 0.
    key_start = jax.random.fold_in(key, 2**32 - 1)
    if start is None:
        state = jax.jit(AMCL.init_global)(amcl, key_start)
    else:
        deviations = configuration.start.deviation, configuration.start.rotation_deviation
        state = start_at(amcl, key_start, start, deviations)

    folder = command.out or default_folder(command.log, "amcl", command.seed)
    make_folder(folder)
    clouds: list[Cloud] = []
    result = localize_log(
        amcl,
        key,
        state,
        prepared,
        progress=sys.stderr.isatty(),
        on_chunk=clouds.append if command.gif else None,
    )
    warn(result.warnings)
    measured = None if reference is None else _error(result, reference, log, command)
    if command.gif:
        animate_clouds(folder / "cloud.gif", occupancy, clouds)
    metrics = write_localization(
        folder,
        result,
        configuration,
        occupancy,
        prepared,
        seed=command.seed,
        origin={
            "command": shlex.join(["jaxslam", *arguments]),
            "log": {"path": str(command.log.resolve()), "sha256": file_sha256(command.log)},
            "map": {"path": str(command.map.resolve()), "sha256": file_sha256(command.map)},
            "start": "global" if start is None else list(start),
            "range_network": network_origin(command.range_network),
            "versions": versions(),
        },
        error=measured,
    )
    _print_summary(folder, result, metrics)


def _warn_if_far(path: Path, occupancy: OccupancyMap) -> None:
    farthest = float(np.abs(occupancy.origin[:2]).max())
    if farthest > _FAR:
        precision = float(np.spacing(np.float32(farthest)))
        warn(
            [
                f"{path}: its origin is {farthest:.0f} m off, where positions are only good to "
                f"{precision:.2g} m: move the origin"
            ]
        )


def _error(
    result: LocalizationResult, reference: tuple, log: SensorLog, command: Localize
) -> TrajectoryError | None:
    """In the map's own frame, from the first agreement on: before it there is no estimate."""
    assert log.odometry is not None  # `prepare_inputs` has looked
    if not result.agreed.any():
        warn((f"{command.reference}: no error is given: the particles never agreed",))
        return None
    since = result.all_stamps >= result.stamps[np.argmax(result.agreed)]
    stamps, poses = reference
    try:
        return reference_error(
            stamps, poses, result.all_stamps[since], result.all_poses[since], log.odometry, align=False
        )
    except ValueError as error:
        # The run is whole without it.
        warn((f"{command.reference}: no error is given: since the particles first agreed, {error}",))
        return None


def _start(command: Localize) -> tuple[float, float, float] | None:
    if (command.start is None) == (not command.global_):
        raise ValueError("give either --start X,Y,THETA (metres, metres, radians) or --global")
    if command.start is None:
        return None
    parts = command.start.split(",")
    try:
        pose = tuple(float(part) for part in parts)
    except ValueError:
        pose = ()
    if len(pose) != 3 or not np.isfinite(pose).all():
        raise ValueError(f"--start is {command.start!r}: give X,Y,THETA in metres, metres and radians")
    x, y, theta = pose
    return x, y, theta


def _print_summary(folder: Path, result: LocalizationResult, metrics: dict) -> None:
    x, y, theta = result.estimates[-1]
    deviation = float(np.sqrt(np.trace(result.covariances[-1][:2, :2])))
    live = np.asarray(result.infos.num_live)
    after = metrics["converged_after_s"]
    lines = {
        "scans": f"{len(result.stamps)} processed of {len(result.all_stamps)}",
        "time": (
            f"{result.ms_per_scan:.2f} ms per scan, compilation {result.compile_s:.1f} s apart; "
            f"{metrics['beam_evaluations_per_s']:.2g} beams per second"
        ),
        "particles": f"{live[0]} at first, {int(np.median(live))} in the median, {live[-1]} at the end",
        "converged": (
            ("yes" if result.converged else "no")
            + ("" if after is None else f", first after {after:.1f} s")
            + f"; settled elsewhere {result.kidnapped_events} times"
        ),
        "end": f"x {x:.2f} m, y {y:.2f} m, {np.rad2deg(theta):.1f}°, ± {deviation:.2f} m",
    }
    if np.isfinite(metrics["match_score"]):
        lines["match"] = f"{100 * metrics['match_score']:.1f} % of the beams end on the map"
    if ate := metrics.get("ate"):
        lines["error"] = (
            f"{ate['rmse_m']:.4f} m RMSE, max {ate['max_m']:.3f} m, heading {ate['rot_rmse_deg']:.2f}° "
            f"({ate['n']} poses)"
        )
    lines["written"] = f"{folder} (cloud.png, trajectory.tum, metrics.json, …)"
    for label, text in lines.items():
        print(f"{label:<10}{text}")
