"""One reader for every kind of log, chosen by the content of the file."""

from pathlib import Path

from jaxslam.io.bag.file import MCAP_MAGIC, ROS1_MAGIC, SQLITE_MAGIC
from jaxslam.io.bag.reader import read_bag
from jaxslam.io.carmen.reader import read_carmen
from jaxslam.io.files import GZIP_MAGIC, read_head
from jaxslam.io.log import LogError, SensorLog

_CARMEN_SUFFIXES = (".log", ".clf", ".gz", ".carmen")
_BAG_SUFFIXES = (".bag", ".mcap", ".db3")


def read_log(
    path: str | Path,
    *,
    scan_topic: str | None = None,
    odometry_topic: str | None = None,
    imu_topic: str | None = None,
    joint_topic: str | None = None,
    fix_topic: str | None = None,
) -> SensorLog:
    """Read a log of any kind; see `read_carmen` and `read_bag`.

    The kind is detected from the content (gzip, ROS 1 bag, MCAP, SQLite), then from the suffix. Topics are
    for bags only; a topic that is None is detected.

    Args:
        path: the log file, or the folder of a ROS 2 bag.
        scan_topic: topic of the scans.
        odometry_topic: topic of the wheel odometry.
        imu_topic: topic of the inertial measurements.
        joint_topic: topic of the wheel angles.
        fix_topic: topic of the satellite fixes.

    Returns:
        The log; tracks without data are None.

    Raises:
        LogError: the file is missing, of unknown kind or unusable, or topics were given for a CARMEN log.
    """
    path = Path(path)
    topics = {
        "scan_topic": scan_topic,
        "odometry_topic": odometry_topic,
        "imu_topic": imu_topic,
        "joint_topic": joint_topic,
        "fix_topic": fix_topic,
    }
    if _is_bag(path):
        return read_bag(path, **topics)
    given = [f"{name}={value!r}" for name, value in topics.items() if value is not None]
    if given:
        raise LogError(f"{path}: a CARMEN log has no topics: leave out {', '.join(given)}")
    return read_carmen(path)


def _is_bag(path: Path) -> bool:
    if path.is_dir():
        return True
    head = read_head(path)
    if head.startswith((ROS1_MAGIC, MCAP_MAGIC, SQLITE_MAGIC)):
        return True
    if head.startswith(GZIP_MAGIC) or path.suffix in _CARMEN_SUFFIXES:
        return False
    if path.suffix in _BAG_SUFFIXES:
        return True
    raise LogError(
        f"{path}: unknown kind of log: expected a CARMEN log (.log, .clf, also .gz), a ROS 1 bag (.bag), "
        "a ROS 2 bag (.mcap, .db3, or its folder with metadata.yaml)"
    )
