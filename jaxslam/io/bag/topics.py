"""Choice of a bag's topics: by the given name, else by the usual names."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from jaxslam.core.names import did_you_mean
from jaxslam.io.log import LogError, list_counts

SCAN = "sensor_msgs/msg/LaserScan"
ODOMETRY = "nav_msgs/msg/Odometry"
IMU = "sensor_msgs/msg/Imu"
JOINT = "sensor_msgs/msg/JointState"
FIX = "sensor_msgs/msg/NavSatFix"
TRANSFORMS = "tf2_msgs/msg/TFMessage"

# Usual topic names of each kind, the most common first.
_USUAL_NAMES: dict[str, Sequence[str]] = {
    SCAN: ("/scan", "/base_scan", "/laser_scan", "/front/scan", "/scan_front", "/scan_raw"),
    ODOMETRY: ("/odom", "/odometry", "/wheel_odom", "/wheel/odometry", "/odom_raw"),
    IMU: ("/imu", "/imu/data", "/imu/data_raw", "/imu_raw"),
    JOINT: ("/joint_states",),
    FIX: ("/fix", "/gps/fix", "/navsat/fix"),
}


def choose_topic(
    path: Path, topics: Mapping[str, tuple[str, int]], kind: str, wanted: str | None, warnings: list[str]
) -> str | None:
    """Pick the topic of one message type.

    Args:
        path: the bag, for error messages.
        topics: message type and number of messages by topic.
        kind: the message type.
        wanted: name of a topic, with or without the leading slash; None chooses a topic with a usual
            name, else the topic with most messages.
        warnings: list to which the topics that are not used are appended.

    Returns:
        The topic; None if no topic of that type has a message.

    Raises:
        LogError: the wanted topic is missing, has another type or has no message.
    """
    filled = {name: count for name, (type_, count) in topics.items() if type_ == kind and count}
    if wanted is not None:
        name = next((name for name in (wanted, f"/{wanted}") if name in topics), None)
        if name is not None and name in filled:
            return name
        if name is None:
            fault = f"no topic '{wanted}': {did_you_mean(wanted, filled or topics)}"
        elif topics[name][0] == kind:
            fault = f"topic '{name}' has no messages: "
        else:
            fault = f"topic '{name}' is {_short(topics[name][0])}, not {_short(kind)}: "
        raise LogError(f"{path}: {fault}{_short(kind)} topics here: {list_counts(filled) or 'none'}")
    if not filled:
        return None
    usual = [name for name in _USUAL_NAMES[kind] if name in filled]
    chosen = usual[0] if usual else max(filled, key=lambda name: (filled[name], name))
    if len(filled) > 1:
        others = list_counts({name: count for name, count in filled.items() if name != chosen})
        warnings.append(f"{chosen} chosen as {_short(kind)} of {len(filled)} topics; not used: {others}")
    return chosen


def _short(kind: str) -> str:
    return kind.replace("/msg/", "/")
