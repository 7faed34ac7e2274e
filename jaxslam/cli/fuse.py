"""`jaxslam fuse LOG`."""

import shlex

import numpy as np
from jaxtyping import Float64

from jaxslam.cli.arguments import Fuse
from jaxslam.cli.common import warn, warn_if_assumed
from jaxslam.config.fusion import FusionSettings
from jaxslam.fusion import EKF, Fused
from jaxslam.io import LogError, read_log, write_tum
from jaxslam.io.gps import east_north
from jaxslam.io.log import SensorLog
from jaxslam.metrics import absolute_trajectory_error
from jaxslam.pipeline.fusion import fuse_tracks
from jaxslam.preprocess.wheels import wheel_odometry
from jaxslam.report import file_sha256, make_folder, versions
from jaxslam.report.folder import write_json

_GPS_WITHIN = 0.3
"""A fix and a pose further apart in time than this are not compared, seconds."""


def execute(command: Fuse, arguments: list[str]) -> None:
    """Fuses odometry and IMU of a log and writes the trajectory."""
    log = read_log(command.log, odometry_topic=command.odom_topic, imu_topic=command.imu_topic)
    warn(log.warnings)
    if log.imu is None:
        raise LogError(f"{log.path}: no IMU in it, so there is nothing to fuse (see `jaxslam info`)")
    odometry = log.odometry
    if command.wheel_radius is not None or command.track is not None:
        odometry = _wheels(command, log)
    settings = FusionSettings(
        yaw_axis=command.imu_yaw_axis or "auto",
        read_poses=command.odometry_poses,
        read_headings=command.imu_headings,
        ekf=EKF(frame="world" if command.world_frame else "body"),
    )
    fixes = _fixes(log) if command.gps else None
    stamps = log.imu.stamps if odometry is None else odometry.stamps
    fused, yaw = fuse_tracks(settings, odometry, log.imu, stamps)
    warn_if_assumed(yaw)
    folder = command.out
    make_folder(folder)
    write_tum(folder / "trajectory.tum", fused.stamps, fused.poses)
    _save_sigmas(folder / "sigma.png", fused)
    metrics: dict[str, object] = {
        "readings": fused.readings,
        "refused": fused.refused,
        "rates_hz": {
            "odometry": None if odometry is None else _rate(odometry.stamps),
            "imu": _rate(log.imu.stamps),
        },
        "imu_axis": [float(part) for part in yaw.axis],
        "imu_axis_from": yaw.source,
        "gyro_bias_rad_s": yaw.bias,
    }
    lines = {
        "odometry": f"{fused.readings['odometry']} readings, {fused.refused['odometry']} refused by the gate",
        "IMU": f"{fused.readings['imu']} readings, {fused.refused['imu']} refused; up is "
        f"{_axis_name(yaw.axis)} ({yaw.source}), bias {yaw.bias:.2e} rad/s",
    }
    if fixes is not None:
        for name, track in (("fused", (fused.stamps, fused.poses)), ("wheels", odometry)):
            if track is None:
                continue
            poses = track if isinstance(track, tuple) else (track.stamps, track.poses)
            error = absolute_trajectory_error(*fixes, *poses, max_difference=_GPS_WITHIN)
            key = "gps" if name == "fused" else "gps_odometry_alone"
            metrics[key] = {"rmse_m": error.rmse_m, "max_m": error.max_m, "n": error.n}
            lines[f"GPS, {name}"] = f"{error.rmse_m:.2f} m RMSE, max {error.max_m:.2f} m ({error.n} fixes)"
    write_json(folder / "metrics.json", metrics)
    write_json(
        folder / "run.json",
        {
            "command": shlex.join(["jaxslam", *arguments]),
            "log": {"path": str(command.log.resolve()), "sha256": file_sha256(command.log)},
            "versions": versions(),
        },
    )
    lines["written"] = f"{folder} (trajectory.tum, sigma.png, metrics.json, run.json)"
    for label, text in lines.items():
        print(f"{label:<14}{text}")


def _wheels(command: Fuse, log: SensorLog):
    if command.wheel_radius is None or command.track is None:
        raise ValueError("--wheel-radius and --track go together: give both, metres")
    if log.joints is None:
        raise LogError(f"{log.path}: no wheel angles (JointState) in it for --wheel-radius and --track")
    return wheel_odometry(log.joints, command.wheel_radius, command.track)


def _fixes(log: SensorLog) -> tuple[Float64[np.ndarray, "M"], Float64[np.ndarray, "M 3"]]:
    """Stamps and places in metres east and north; the third column is no heading."""
    if log.fixes is None:
        raise LogError(f"{log.path}: no GPS fix in it for --gps")
    return log.fixes.stamps, np.pad(east_north(log.fixes.positions), ((0, 0), (0, 1)))


def _rate(stamps: Float64[np.ndarray, "M"]) -> float | None:
    if len(stamps) < 2:
        return None
    return float((len(stamps) - 1) / (stamps[-1] - stamps[0]))


def _axis_name(axis: Float64[np.ndarray, "3"]) -> str:
    strongest = int(np.argmax(np.abs(axis)))
    return ("-" if axis[strongest] < 0 else "") + "xyz"[strongest]


def _save_sigmas(path, fused: Fused) -> None:
    """Three standard deviations of position and heading over time."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from jaxslam.viz import style

    figure = Figure(figsize=(8.0, 5.0), layout="constrained")
    FigureCanvasAgg(figure)
    above, below = figure.subplots(2, sharex=True)
    time = fused.stamps - fused.stamps[0]
    above.plot(time, 3 * np.hypot(fused.sigmas[:, 0], fused.sigmas[:, 1]), color=style.ESTIMATE)
    below.plot(time, 3 * np.rad2deg(fused.sigmas[:, 2]), color=style.ESTIMATE)
    style.curve_axes(above, "", "3 σ of position (m)")
    style.curve_axes(below, "time (s)", "3 σ of heading (°)")
    figure.savefig(path, dpi=150)
