"""`jaxslam info LOG`."""

from dataclasses import dataclass

from jaxslam.cli.common import LogPath, Topic, describe_timing


@dataclass(frozen=True)
class Info:
    """Show what is in a log: counts, rates, beams, ranges, path, gaps."""

    log: LogPath
    """The log file, or the folder of a ROS 2 bag."""
    scan_topic: Topic = None
    """Laser-scan topic (ROS bags only)."""
    odom_topic: Topic = None
    """Wheel-odometry topic (ROS bags only)."""
    imu_topic: Topic = None
    """IMU topic (ROS bags only)."""


def execute(command: Info, arguments: list[str]) -> None:
    """Print what is in a log."""
    from jaxslam.config.lidar_presets import detect_lidar
    from jaxslam.io import read_log, summarize
    from jaxslam.preprocess.ranges import correct_scans

    log = read_log(
        command.log,
        scan_topic=command.scan_topic,
        odometry_topic=command.odom_topic,
        imu_topic=command.imu_topic,
    )
    print(summarize(log))
    missing = [name for name in ("scans", "odometry") if getattr(log, name) is None]
    if missing:
        print(f"cannot map    the log has no {' and no '.join(missing)}")
    if log.scans is not None and len(log.scans.stamps):
        preset = detect_lidar(log)
        print(f"lidar preset  {preset.name}")
        _, timing = correct_scans(log, preset)
        if stamped := describe_timing(timing):
            print(f"scans         {stamped}")
