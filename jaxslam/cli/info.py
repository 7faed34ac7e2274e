"""`jaxslam info LOG`."""

from jaxslam.cli.arguments import Info
from jaxslam.cli.common import describe_timing
from jaxslam.config.lidar import LidarSettings
from jaxslam.config.lidar_presets import detect_lidar
from jaxslam.io import read_log, summarise
from jaxslam.preprocess.ranges import correct_scans


def execute(command: Info, arguments: list[str]) -> None:
    """Prints what is in a log."""
    log = read_log(
        command.log,
        scan_topic=command.scan_topic,
        odometry_topic=command.odom_topic,
        imu_topic=command.imu_topic,
    )
    print(summarise(log))
    missing = [name for name in ("scans", "odometry") if getattr(log, name) is None]
    if missing:
        print(f"cannot map    no {' and no '.join(missing)} in it")
    if log.scans is not None and len(log.scans.stamps):
        preset = detect_lidar(log)
        print(f"lidar preset  {preset.name}")
        _, timing = correct_scans(log, LidarSettings.of(preset))
        if stamped := describe_timing(timing):
            print(f"scans         {stamped}")
