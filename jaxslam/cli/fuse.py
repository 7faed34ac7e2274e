"""`jaxslam fuse LOG`."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from jaxslam.cli import common, options

if TYPE_CHECKING:
    import numpy as np
    from jaxtyping import Float64

    from jaxslam.fusion import FusedMotion
    from jaxslam.io import OdometryTrack, SensorLog

_GPS_WITHIN = 0.3
"""Largest time between a fix and a pose that are compared, seconds."""


@dataclass(frozen=True)
class Fuse:
    """Flags of `jaxslam fuse`."""

    log: options.Log
    out: Annotated[Path | None, options.optional("DIR", "runs/<log>-fuse", options.FOLDER)] = None
    imu_yaw_axis: options.YawAxis = None
    gps: options.Switch = False
    """Compare with the GPS fixes of the log, after the best rotation and translation."""
    wheel_radius: Annotated[float | None, options.optional("METERS", "none")] = None
    """Wheel radius, to compute the odometry from the wheel angles (JointState) of the log; needs --track."""
    track: Annotated[float | None, options.optional("METERS", "none")] = None
    """Distance between the wheels, for --wheel-radius."""
    odometry_poses: options.Switch = False
    """Also use the poses of the odometry, not only its velocities (as Liang et al.)."""
    imu_headings: options.Switch = False
    """Also use the heading of the IMU, not only its yaw rate. A compass near iron makes it unreliable."""
    world_frame: options.Switch = False
    """Use the linear filter with velocities along the world axes (as Liang et al.)."""
    odom_topic: options.OdomTopic = None
    imu_topic: options.ImuTopic = None


def execute(command: Fuse, arguments: list[str]) -> None:
    """Fuse odometry and IMU of a log and write the trajectory."""
    from jaxslam.config.fusion import FusionSettings
    from jaxslam.fusion import EKF
    from jaxslam.io import LogError, write_tum
    from jaxslam.metrics import absolute_trajectory_error
    from jaxslam.pipeline.fusion import fuse_tracks
    from jaxslam.report import default_folder, make_folder
    from jaxslam.report.folder import write_json

    log = common.read_log(command.log, odom_topic=command.odom_topic, imu_topic=command.imu_topic)
    if log.imu is None:
        raise LogError(
            f"{log.path}: no IMU in it, so there is nothing to fuse: give a log with an IMU (see `info`)"
        )
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
    common.warn_if_assumed(yaw)
    folder = command.out or default_folder(command.log, "fuse")
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
        "odometry": f"{fused.readings['odometry']} readings, {fused.refused['odometry']} rejected by gating",
        "IMU": f"{fused.readings['imu']} readings, {fused.refused['imu']} rejected; up is "
        f"{_axis_name(yaw.axis)} ({yaw.source}), bias {yaw.bias:.2e} rad/s",
    }
    if fixes is not None:
        for key, label, track in (("gps", "fused", fused), ("gps_odometry_alone", "wheels", odometry)):
            if track is None:
                continue
            error = absolute_trajectory_error(*fixes, track.stamps, track.poses, max_difference=_GPS_WITHIN)
            metrics[key] = {"rmse_m": error.rmse_m, "max_m": error.max_m, "n": error.n}
            lines[f"GPS, {label}"] = f"{error.rmse_m:.2f} m RMSE, max {error.max_m:.2f} m ({error.n} fixes)"
    write_json(folder / "metrics.json", metrics)
    write_json(folder / "run.json", common.origin_of(arguments, log=command.log))
    lines["written"] = f"{folder} (trajectory.tum, sigma.png, metrics.json, run.json)"
    common.print_table(lines, width=14)


def _wheels(command: Fuse, log: "SensorLog") -> "OdometryTrack":
    from jaxslam.io import LogError
    from jaxslam.preprocess.wheels import wheel_odometry

    if command.wheel_radius is None or command.track is None:
        raise ValueError("--wheel-radius and --track go together: give both, meters")
    if log.joints is None:
        raise LogError(
            f"{log.path}: no wheel angles (JointState) in it: leave out --wheel-radius and --track"
        )
    return wheel_odometry(log.joints, command.wheel_radius, command.track)


def _fixes(log: "SensorLog") -> "tuple[Float64[np.ndarray, 'M'], Float64[np.ndarray, 'M 3']]":
    """Return stamps and positions in meters east and north; the third column is not a heading."""
    import numpy as np

    from jaxslam.io import LogError
    from jaxslam.io.gps import east_north

    if log.fixes is None:
        raise LogError(f"{log.path}: no GPS fix in it: leave out --gps")
    return log.fixes.stamps, np.pad(east_north(log.fixes.positions), ((0, 0), (0, 1)))


def _rate(stamps: "Float64[np.ndarray, 'M']") -> float | None:
    if len(stamps) < 2:
        return None
    return float((len(stamps) - 1) / (stamps[-1] - stamps[0]))


def _axis_name(axis: "Float64[np.ndarray, '3']") -> str:
    import numpy as np

    strongest = int(np.argmax(np.abs(axis)))
    return ("-" if axis[strongest] < 0 else "") + "xyz"[strongest]


def _save_sigmas(path: Path, fused: "FusedMotion") -> None:
    """Draw three standard deviations of position and heading over time."""
    import numpy as np
    from matplotlib.figure import Figure

    from jaxslam.viz import style

    figure = Figure(figsize=(8.0, 5.0), layout="constrained")
    above, below = figure.subplots(2, sharex=True)
    time = fused.stamps - fused.stamps[0]
    above.plot(time, 3 * np.hypot(fused.sigmas[:, 0], fused.sigmas[:, 1]), color=style.ESTIMATE)
    below.plot(time, 3 * np.rad2deg(fused.sigmas[:, 2]), color=style.ESTIMATE)
    style.curve_axes(above, "", "3 σ of position (m)")
    style.curve_axes(below, "time (s)", "3 σ of heading (°)")
    figure.savefig(path, dpi=150)
