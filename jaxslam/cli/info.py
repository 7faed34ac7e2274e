"""`jaxslam info LOG`."""

from dataclasses import dataclass

from jaxslam.cli import common, options


@dataclass(frozen=True)
class Info:
    """Flags of `jaxslam info`."""

    log: options.Log
    scan_topic: options.ScanTopic = None
    odom_topic: options.OdomTopic = None
    imu_topic: options.ImuTopic = None


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
        if stamped := common.describe_timing(timing):
            print(f"scans         {stamped}")
