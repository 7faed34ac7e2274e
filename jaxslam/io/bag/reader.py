"""Reader for ROS bags: ROS 1 `.bag`, ROS 2 `.mcap` and `.db3`, and ROS 2 bag folders."""

from pathlib import Path

import numpy as np

from jaxslam.io.bag import topics as kinds
from jaxslam.io.bag.file import BagFile
from jaxslam.io.bag.topics import choose_topic
from jaxslam.io.bag.tracks import (
    common_frame,
    fix_track,
    imu_track,
    in_order,
    joint_track,
    odometry_track,
    scan_track,
)
from jaxslam.io.bag.transforms import (
    TILT_WARNING,
    PlanarMounting,
    Tree,
    find_pose,
    planar_mounting,
    transform_matrix,
)
from jaxslam.io.log import LogError, SensorLog


def read_bag(
    path: str | Path,
    *,
    scan_topic: str | None = None,
    odometry_topic: str | None = None,
    imu_topic: str | None = None,
    joint_topic: str | None = None,
    fix_topic: str | None = None,
) -> SensorLog:
    """Read a ROS bag.

    Supported are `sensor_msgs` LaserScan, Imu, JointState and NavSatFix, `nav_msgs/Odometry`, and
    `tf2_msgs/TFMessage` on `/tf_static`; every other topic is counted in `topics` and skipped. By
    default, a topic with a usual name (`/scan`, `/odom`, `/imu`, …) is chosen, else the topic with
    most messages; if there are several candidates, `warnings` lists the unused ones.

    Stamps are taken from the headers. The mounting of lidar and IMU is computed from the static
    transforms, from the odometry's child frame (else base_link, base_footprint) to the sensor's frame.
    The beam angles of an upside-down lidar are negated, so that they are correct in the plane with
    `pose_base_lidar`.

    Args:
        path: the bag file or folder.
        scan_topic: topic of the scans; all topics can be given without the leading slash.
        odometry_topic: topic of the wheel odometry.
        imu_topic: topic of the inertial measurements.
        joint_topic: topic of the wheel angles.
        fix_topic: topic of the satellite fixes.

    Returns:
        The log; tracks without messages are None.

    Raises:
        LogError: the bag is missing, cut or damaged; a topic is unknown or empty; stamps jump back by
            more than a second.
    """
    path = Path(path)
    wanted = {
        kinds.SCAN: scan_topic,
        kinds.ODOMETRY: odometry_topic,
        kinds.IMU: imu_topic,
        kinds.JOINT: joint_topic,
        kinds.FIX: fix_topic,
    }
    warnings: list[str] = []
    with BagFile(path) as bag:
        chosen = _choose_topics(bag, wanted, warnings)
        timed = {
            kind: in_order(path, topic, list(bag.messages(topic)), warnings) for kind, topic in chosen.items()
        }
        tree = _transform_tree(bag, warnings)
    counts = {topic: count for topic, (_, count) in bag.topics.items()}

    base_frames = ["base_link", "base_footprint"]
    odometry = imu = joints = fixes = scans = None
    if messages := timed.get(kinds.ODOMETRY):
        odometry = odometry_track(messages, warnings)
        child = common_frame(m.child_frame_id for m in messages.contents)
        base_frames = [frame for frame in (child, *base_frames) if frame]
    if messages := timed.get(kinds.IMU):
        pose = find_pose(tree, base_frames, common_frame(m.header.frame_id for m in messages.contents))
        imu = imu_track(messages, None if pose is None else pose[:3, :3])
    if messages := timed.get(kinds.JOINT):
        joints = joint_track(messages)
    if messages := timed.get(kinds.FIX):
        fixes = fix_track(messages, warnings)
    if messages := timed.get(kinds.SCAN):
        frame = common_frame(m.header.frame_id for m in messages.contents)
        scans = scan_track(messages, _lidar_mounting(tree, base_frames, frame, warnings), warnings)
    return SensorLog(path, odometry, imu, joints, fixes, scans, tuple(warnings), counts)


def _choose_topics(bag: BagFile, wanted: dict[str, str | None], warnings: list[str]) -> dict[str, str]:
    """Return the topic of each message type that the bag has."""
    chosen = {}
    for kind, name in wanted.items():
        topic = choose_topic(bag.path, bag.topics, kind, name, warnings)
        if topic is not None:
            chosen[kind] = topic
    if not chosen:
        found = sorted({kind for kind, count in bag.topics.values() if count})
        raise LogError(
            f"{bag.path}: no scans, odometry, IMU, joint states or fixes in this bag; it has "
            f"messages of the types {', '.join(found) or 'none'}: was it recorded with all topics?"
        )
    return chosen


def _transform_tree(bag: BagFile, warnings: list[str]) -> Tree:
    transforms = [
        transform
        for topic, (kind, count) in bag.topics.items()
        if kind == kinds.TRANSFORMS and count and topic.endswith("tf_static")
        for message, _ in bag.messages(topic)
        for transform in message.transforms
    ]
    parents, bad = {}, 0
    for transform in transforms:
        matrix = transform_matrix(transform.transform)
        if matrix is None:
            bad += 1
        else:
            child = transform.child_frame_id.lstrip("/")
            parents[child] = (transform.header.frame_id.lstrip("/"), matrix)
    if bad:
        warnings.append(f"{bad} static transforms are not rigid motions: skipped")
    return parents


def _lidar_mounting(
    tree: Tree, base_frames: list[str], frame: str, warnings: list[str]
) -> PlanarMounting | None:
    pose = find_pose(tree, base_frames, frame)
    if pose is None:
        warnings.append(
            f"no static transform from {' or '.join(dict.fromkeys(base_frames))} to the lidar's "
            f"frame '{frame}': its mounting is unknown"
        )
        return None
    mounting = planar_mounting(pose)
    if mounting.upside_down:
        warnings.append(f"the lidar '{frame}' is upside down: beam angles mirrored")
    if mounting.tilt > TILT_WARNING:
        warnings.append(f"the lidar '{frame}' is tilted by {np.rad2deg(mounting.tilt):.0f}°: taken as level")
    return mounting
