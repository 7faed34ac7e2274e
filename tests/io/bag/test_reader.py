"""ROS bags: small ones written here with rosbags, the real ones, and everything that is wrong."""

import sys

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation

from jaxslam.core.names import MissingExtraError
from jaxslam.io import LogError, read_bag, summarize

SCAN = "sensor_msgs/msg/LaserScan"
ODOMETRY = "nav_msgs/msg/Odometry"


class Messages:
    """Builds messages of one ROS version."""

    def __init__(self, store):
        self.store = get_typestore(store)
        if store == Stores.ROS1_NOETIC:
            definition = "geometry_msgs/TransformStamped[] transforms"
            self.store.register(get_types_from_msg(definition, "tf2_msgs/msg/TFMessage"))
        self.types = self.store.types
        self.ros1 = store == Stores.ROS1_NOETIC

    def header(self, t, frame=""):
        second = int(np.floor(t))
        stamp = self.types["builtin_interfaces/msg/Time"](second, round((t - second) * 1e9))
        sequence = (0,) if self.ros1 else ()
        return self.types["std_msgs/msg/Header"](*sequence, stamp, frame)

    def scan(self, t, ranges, frame="laser", increment=0.01, limits=(0.1, 10.0)):
        values = np.array(ranges, dtype=np.float32)
        last = -0.5 + 0.01 * max(values.size - 1, 0)
        return self.types[SCAN](
            self.header(t, frame), -0.5, last, increment, 0.0, 0.0, *limits, values, values[:0]
        )

    def vector(self, x=0.0, y=0.0, z=0.0):
        return self.types["geometry_msgs/msg/Vector3"](x, y, z)

    def quaternion(self, rotation):
        return self.types["geometry_msgs/msg/Quaternion"](*rotation.as_quat())

    def odometry(self, t, x=0.0, yaw=0.0, child="base_footprint", rate=0.0):
        point = self.types["geometry_msgs/msg/Point"](x, 2.0, 0.0)
        rotation = self.quaternion(Rotation.from_euler("z", yaw))
        pose = self.types["geometry_msgs/msg/Pose"](point, rotation)
        twist = self.types["geometry_msgs/msg/Twist"](self.vector(0.1), self.vector(z=rate))
        covariance = np.zeros(36)
        return self.types[ODOMETRY](
            self.header(t, "odom"),
            child,
            self.types["geometry_msgs/msg/PoseWithCovariance"](pose, covariance),
            self.types["geometry_msgs/msg/TwistWithCovariance"](twist, covariance),
        )

    def imu(self, t, frame="imu", absent=0.0):
        covariance = np.zeros(9)
        return self.types["sensor_msgs/msg/Imu"](
            self.header(t, frame),
            self.quaternion(Rotation.from_euler("z", 0.3)),
            np.full(9, absent),
            self.vector(z=0.2),
            covariance,
            self.vector(z=9.8),
            covariance,
        )

    def joints(self, t, names, positions, velocities=()):
        arrays = (np.array(values, dtype=np.float64) for values in (positions, velocities, ()))
        return self.types["sensor_msgs/msg/JointState"](self.header(t), names, *arrays)

    def fix(self, t, status=0):
        state = self.types["sensor_msgs/msg/NavSatStatus"](status=status, service=1)
        return self.types["sensor_msgs/msg/NavSatFix"](
            self.header(t), state, 42.0, -71.0, 5.0, np.zeros(9), 0
        )

    def transforms(self, *edges):
        """Static transforms of edges (parent, child, (x, y, z), (roll, pitch, yaw))."""
        stamped = [
            self.types["geometry_msgs/msg/TransformStamped"](
                self.header(0.0, parent),
                child,
                self.types["geometry_msgs/msg/Transform"](
                    self.vector(*position), self.quaternion(Rotation.from_euler("xyz", angles))
                ),
            )
            for parent, child, position, angles in edges
        ]
        return self.types["tf2_msgs/msg/TFMessage"](stamped)


BUILD1, BUILD2 = Messages(Stores.ROS1_NOETIC), Messages(Stores.ROS2_HUMBLE)


def write_bag1(path, topics):
    with Writer1(path) as writer:
        for topic, messages in topics.items():
            kind = messages[0].__msgtype__
            connection = writer.add_connection(topic, kind, typestore=BUILD1.store)
            for index, message in enumerate(messages):
                data = BUILD1.store.serialize_ros1(message, kind)
                writer.write(connection, int((100 + index) * 1e9), data)
    return path


def write_bag2(path, topics, plugin=StoragePlugin.MCAP, empty=(), store=BUILD2.store):
    with Writer2(path, version=9, storage_plugin=plugin) as writer:
        for topic, kind in empty:
            writer.add_connection(topic, kind, typestore=store)
        for topic, messages in topics.items():
            kind = messages[0].__msgtype__
            connection = writer.add_connection(topic, kind, typestore=store)
            for index, message in enumerate(messages):
                data = store.serialize_cdr(message, kind)
                writer.write(connection, int((100 + index) * 1e9), data)
    return path


def robot(build):
    """Topics of a robot with every kind of track; the lidar is 0.2 m ahead of the base."""
    return {
        "/scan": [build.scan(1.0 + i, [1.0, 2.0 + i, 3.0]) for i in range(3)],
        "/odom": [build.odometry(1.0 + i / 2, x=i, yaw=0.1 * i, rate=143.0) for i in range(5)],
        "/imu": [build.imu(1.0), build.imu(2.0, absent=-1.0)],
        "/joint_states": [
            build.joints(1.0, ["left", "right"], [0.1, 0.2], [1.0, 2.0]),
            build.joints(2.0, ["right"], [0.4]),
        ],
        "/fix": [build.fix(1.0), build.fix(2.0, status=-1)],
        "/tf_static": [
            build.transforms(
                ("base_footprint", "base_link", (0.0, 0.0, 0.1), (0.0, 0.0, 0.0)),
                ("base_link", "laser", (0.2, 0.0, 0.1), (0.0, 0.0, 0.0)),
                ("/base_link", "/imu", (0.0, 0.0, 0.0), (np.pi / 2, 0.0, 0.0)),
            )
        ],
    }


@pytest.fixture(params=["bag", "mcap", "mcap folder", "db3 folder"])
def bag(request, tmp_path):
    if request.param == "bag":
        return write_bag1(tmp_path / "a.bag", robot(BUILD1))
    plugin = StoragePlugin.SQLITE3 if "db3" in request.param else StoragePlugin.MCAP
    folder = write_bag2(tmp_path / "a", robot(BUILD2), plugin)
    return folder if "folder" in request.param else next(folder.glob("*.mcap"))


def test_every_track_is_read_from_every_kind_of_bag(bag):
    log = read_bag(bag)
    assert log.warnings == ("/fix: 1 messages without a fix skipped",)
    counts = {"/fix": 2, "/imu": 2, "/joint_states": 2, "/odom": 5, "/scan": 3, "/tf_static": 1}
    assert log.topics == counts
    assert log.scans.topic == "/scan"
    assert log.scans.stamps.tolist() == [1, 2, 3]
    np.testing.assert_array_equal(log.scans.ranges, [[1, 2, 3], [1, 3, 3], [1, 4, 3]])
    np.testing.assert_allclose(log.scans.angle_min, -0.5)
    np.testing.assert_allclose(log.scans.angle_increment, 0.01, rtol=1e-6)
    assert (log.scans.range_min, log.scans.range_max) == pytest.approx((0.1, 10.0))
    np.testing.assert_allclose(log.scans.pose_base_lidar, [0.2, 0, 0], atol=1e-12)
    assert log.scans.mounting_known
    np.testing.assert_allclose(log.odometry.stamps, [1, 1.5, 2, 2.5, 3])
    np.testing.assert_allclose(log.odometry.poses[3], [3, 2, 0.3])
    np.testing.assert_allclose(log.odometry.twists[0], [0.1, 0, 143.0])  # Outliers are kept.
    np.testing.assert_allclose(log.imu.linear_accelerations, [[0, 0, 9.8]] * 2)
    assert np.isfinite(log.imu.orientations).all(axis=1).tolist() == [True, False]
    np.testing.assert_allclose(log.imu.rotation_base_imu @ [0, 1, 0], [0, 0, 1], atol=1e-12)
    assert log.imu.mounting_known
    assert log.joints.names == ("left", "right")
    np.testing.assert_array_equal(log.joints.positions, [[0.1, 0.2], [np.nan, 0.4]])
    np.testing.assert_array_equal(log.joints.velocities, [[1, 2], [np.nan, np.nan]])
    assert log.fixes.positions.tolist() == [[42.0, -71.0, 5.0]]


def test_the_transform_message_of_ros_1_is_the_real_one():
    # The sum that ROS 1 itself gives for tf2_msgs/TFMessage; bags carry it with every topic.
    digest = BUILD1.store.generate_msgdef("tf2_msgs/msg/TFMessage")[1]
    assert digest == "94810edda583a504dfda3829e70d7eec"


def test_another_definition_of_a_type_is_refused(tmp_path):
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg("float64 x", SCAN))
    with Writer1(tmp_path / "a.bag") as writer:
        connection = writer.add_connection("/scan", SCAN, typestore=store)
        writer.write(connection, 1, store.serialize_ros1(store.types[SCAN](1.0), SCAN))
    with pytest.raises(LogError, match="'/scan' has another definition of sensor_msgs/msg/Las"):
        read_bag(tmp_path / "a.bag")


# --- mounting -------------------------------------------------------------------------------


def scans_mounted(tmp_path, *edges, child="base_link"):
    topics = {"/scan": [BUILD2.scan(1.0, [1.0, 2.0])], "/odom": [BUILD2.odometry(1.0, child=child)]}
    if edges:
        topics["/tf_static"] = [BUILD2.transforms(*edges)]
    return read_bag(write_bag2(tmp_path / "a", topics))


def test_transforms_are_composed(tmp_path):
    log = scans_mounted(
        tmp_path,
        ("base_link", "mast", (1.0, 0.0, 0.5), (0.0, 0.0, np.pi / 2)),
        ("mast", "laser", (0.5, 0.0, 0.0), (0.0, 0.0, np.pi / 4)),
    )
    np.testing.assert_allclose(log.scans.pose_base_lidar, [1.0, 0.5, 0.75 * np.pi], atol=1e-7)


def test_the_mounting_is_in_the_frame_of_the_odometry(tmp_path):
    log = scans_mounted(
        tmp_path,
        ("base_link", "laser", (0.3, 0.0, 0.0), (0.0, 0.0, 0.0)),
        ("base_link", "axle", (-0.1, 0.0, 0.0), (0.0, 0.0, 0.0)),
        child="axle",
    )
    np.testing.assert_allclose(log.scans.pose_base_lidar, [0.4, 0, 0], atol=1e-12)


@pytest.mark.parametrize("yaw", [0.0, 0.7, -3.0])
def test_points_of_a_lidar_upside_down_are_right_in_the_plane(tmp_path, yaw):
    rotation = Rotation.from_euler("xyz", (np.pi, 0.0, yaw))
    log = scans_mounted(tmp_path, ("base_link", "laser", (0.2, 0.1, 0.4), (np.pi, 0.0, yaw)))
    scans = log.scans
    angles = -0.5 + 0.01 * np.arange(2)
    ranges = np.array([1.0, 2.0])
    beams = np.stack([ranges * np.cos(angles), ranges * np.sin(angles), np.zeros(2)], axis=1)
    expected = rotation.apply(beams)[:, :2] + [0.2, 0.1]
    bearing = scans.angle_min[0] + scans.angle_increment[0] * np.arange(2)
    heading = scans.pose_base_lidar[2] + bearing
    points = scans.pose_base_lidar[:2] + ranges[:, None] * np.stack(
        [np.cos(heading), np.sin(heading)], axis=1
    )
    np.testing.assert_allclose(points, expected, atol=1e-6)
    assert any("upside down" in line for line in log.warnings)


def test_a_leaning_lidar_is_a_warning(tmp_path):
    log = scans_mounted(tmp_path, ("base_link", "laser", (0.0, 0.0, 0.0), (0.0, 0.3, 0.0)))
    assert any("tilted by 17°" in line for line in log.warnings)


def test_without_transforms_the_mounting_is_unknown(tmp_path):
    log = scans_mounted(tmp_path)
    assert not log.scans.mounting_known
    assert log.scans.pose_base_lidar.tolist() == [0, 0, 0]
    assert any("no static transform from base_link" in line for line in log.warnings)


def test_loops_and_nonsense_in_the_tree_are_survived(tmp_path):
    broken = BUILD2.transforms(("base_link", "laser", (np.nan, 0.0, 0.0), (0.0, 0.0, 0.0)))
    loop = BUILD2.transforms(
        ("laser", "other", (0.0,) * 3, (0.0,) * 3), ("other", "laser", (0.0,) * 3, (0.0,) * 3)
    )
    topics = {"/scan": [BUILD2.scan(1.0, [1.0])], "/tf_static": [broken, loop]}
    log = read_bag(write_bag2(tmp_path / "a", topics))
    assert not log.scans.mounting_known
    assert any("1 static transforms are not rigid" in line for line in log.warnings)


# --- topics ---------------------------------------------------------------------------------


@pytest.fixture
def two_lidars(tmp_path):
    topics = {
        "/rear": [BUILD2.scan(1.0 + i, [2.0]) for i in range(5)],
        "/scan": [BUILD2.scan(1.0 + i, [1.0]) for i in range(2)],
        "/odom": [BUILD2.odometry(1.0)],
    }
    return write_bag2(tmp_path / "a", topics, empty=[("/empty", SCAN)])


def test_usual_names_win_over_numbers_and_the_choice_is_told(two_lidars):
    log = read_bag(two_lidars)
    assert log.scans.topic == "/scan"
    assert "/scan chosen as sensor_msgs/LaserScan of 2 topics; not used: /rear (5)" in log.warnings


@pytest.mark.parametrize("name", ["/rear", "rear"])
def test_a_topic_can_be_asked_for(two_lidars, name):
    assert read_bag(two_lidars, scan_topic=name).scans.ranges[0, 0] == 2


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("/raer", r"no topic '/raer': did you mean '/rear'\? .* here: /rear \(5\), /scan \(2\)"),
        ("/odom", r"topic '/odom' is nav_msgs/Odometry, not sensor_msgs/LaserScan"),
        ("/empty", r"topic '/empty' has no messages: sensor_msgs/LaserScan topics here: /rear"),
    ],
)
def test_a_wrong_topic_is_an_error_that_helps(two_lidars, name, message):
    with pytest.raises(LogError, match=message):
        read_bag(two_lidars, scan_topic=name)


def test_most_messages_win_among_unusual_names(tmp_path):
    topics = {
        "/one": [BUILD2.scan(1.0, [1.0])],
        "/two": [BUILD2.scan(1.0, [2.0]), BUILD2.scan(2.0, [2.0])],
    }
    assert read_bag(write_bag2(tmp_path / "a", topics)).scans.topic == "/two"


def test_types_nobody_knows_are_skipped_and_counted(tmp_path):
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg("float64 secret", "robot_msgs/msg/Own"))
    own = [store.types["robot_msgs/msg/Own"](1.0)] * 4
    topics = {"/own": own, "/scan": [BUILD2.scan(1.0, [1.0])]}
    log = read_bag(write_bag2(tmp_path / "a", topics, store=store))
    assert log.topics == {"/own": 4, "/scan": 1}
    # `summarize` lists the topics that are not used: a warning would hide the others.
    assert not any("/own" in line for line in log.warnings)
    assert "not used      /own (4)" in summarize(log)


def test_a_bag_with_nothing_useful_is_an_error(tmp_path):
    topics = {"/tf_static": [BUILD2.transforms()]}
    with pytest.raises(LogError, match=r"no scans, odometry, IMU.*tf2_msgs/msg/TFMessage"):
        read_bag(write_bag2(tmp_path / "a", topics, empty=[("/scan", SCAN)]))


# --- messages -------------------------------------------------------------------------------


def scans_of(tmp_path, *messages):
    return read_bag(write_bag2(tmp_path / "a", {"/scan": list(messages)}))


def test_scans_of_changing_size_are_padded_and_cleaned(tmp_path):
    log = scans_of(
        tmp_path,
        BUILD2.scan(1.0, [0.05, np.nan, np.inf, 10.0, -1.0, 5.0]),
        BUILD2.scan(2.0, [1.0, 2.0]),
        BUILD2.scan(3.0, []),
    )
    assert log.scans.stamps.tolist() == [1, 2]
    assert log.scans.num_beams.tolist() == [6, 2]
    nan = np.nan
    np.testing.assert_array_equal(log.scans.ranges, [[nan] * 5 + [5], [1, 2] + [nan] * 4])
    assert any("1 scans without beams" in line for line in log.warnings)


def test_a_missing_increment_follows_from_the_ends(tmp_path):
    scans = scans_of(tmp_path, BUILD2.scan(1.0, [1.0] * 5, increment=0.0)).scans
    assert scans.angle_increment[0] == pytest.approx(0.01, rel=1e-5)


def test_limits_that_are_zero_do_not_empty_the_scan(tmp_path):
    scans = scans_of(tmp_path, BUILD2.scan(1.0, [1.0, 90.0], limits=(0.0, 0.0))).scans
    assert scans.ranges.tolist() == [[1, 90]]
    assert scans.range_max == np.inf


def test_zero_header_stamps_fall_back_to_the_time_of_receipt(tmp_path):
    log = scans_of(tmp_path, *(BUILD2.scan(0.0, [1.0]) for _ in range(3)))
    assert log.scans.stamps.tolist() == [100, 101, 102]
    assert "/scan: header stamps are zero, time of receipt used" in log.warnings


def test_jitter_is_sorted_and_a_clock_set_back_is_an_error(tmp_path):
    log = scans_of(tmp_path, *(BUILD2.scan(t, [t]) for t in (1.0, 1.5, 1.25)))
    assert log.scans.ranges[:, 0].tolist() == [1, 1.25, 1.5]
    assert "/scan: 1 stamps run backwards by up to 0.250 s: sorted by time" in log.warnings
    topics = {"/scan": [BUILD2.scan(t, [1.0]) for t in (50.0, 51.0, 1.0)]}
    with pytest.raises(LogError, match=r"stamps of /scan run backwards by 50\.0 s at message 3 of 3"):
        read_bag(write_bag2(tmp_path / "b", topics))


def test_odometry_that_is_not_finite_is_dropped(tmp_path):
    topics = {"/odom": [BUILD2.odometry(1.0), BUILD2.odometry(2.0, x=np.nan)]}
    log = read_bag(write_bag2(tmp_path / "a", topics))
    assert log.odometry.stamps.tolist() == [1]
    assert "/odom: 1 poses that are not finite skipped" in log.warnings


# --- bad bags -------------------------------------------------------------------------------


@pytest.mark.parametrize("share", [0.1, 0.5, 0.99])
@pytest.mark.parametrize("kind", ["bag", "mcap"])
def test_cut_bags_are_one_line(tmp_path, kind, share):
    if kind == "bag":
        path = write_bag1(tmp_path / "a.bag", robot(BUILD1))
    else:
        path = next(write_bag2(tmp_path / "a", robot(BUILD2)).glob("*.mcap"))
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    with pytest.raises(LogError, match=r"cut short or damaged .* copy it again") as error:
        read_bag(path)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.bag", b"", "is empty"),
        ("a.bag", b"no bag at all", "is not a bag"),
        ("a.mcap", b"#ROSBAG V1.2\n", "cut short or damaged"),
        ("a.mcap", b"\x89MCAP0\r\n", "cut short or damaged"),
        ("a.bin", b"\x89MCAP0\r\n", r"rename it to \*\.mcap"),
        ("a.db3", b"SQLite format 3\0 and garbage", "cut short or damaged"),
    ],
)
def test_what_is_no_bag_is_an_error(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(LogError, match=message):
        read_bag(tmp_path / name)


def test_missing_bags_and_plain_folders_are_errors(tmp_path):
    with pytest.raises(LogError, match="no such file"):
        read_bag(tmp_path / "none.mcap")
    with pytest.raises(LogError, match=r"no metadata\.yaml"):
        read_bag(tmp_path)
    (tmp_path / "metadata.yaml").write_text("nothing: 1\n")
    with pytest.raises(LogError, match="cut short or damaged"):
        read_bag(tmp_path)


def test_without_rosbags_the_error_says_what_to_install(tmp_path, monkeypatch):
    path = write_bag1(tmp_path / "a.bag", robot(BUILD1))
    monkeypatch.setitem(sys.modules, "rosbags.rosbag1", None)
    with pytest.raises(MissingExtraError, match=r"^rosbags is not installed: pip install 'jaxslam\[cli\]'$"):
        read_bag(path)


# --- the real bags --------------------------------------------------------------------------


def test_the_turtlebot(data_dir):
    log = read_bag(data_dir / "bags" / "turtlebot3_drive.mcap")
    assert log.scans.stamps.size == 549
    assert (log.scans.num_beams.min(), log.scans.num_beams.max()) == (258, 263)
    np.testing.assert_allclose(log.scans.pose_base_lidar, [-0.032, 0, 0], atol=1e-9)
    assert log.scans.mounting_known
    assert np.abs(log.odometry.twists[:, 2]).max() > 100
    assert log.joints.names == ("wheel_left_joint", "wheel_right_joint")
    assert log.imu.mounting_known
    # Out and back: the yaw of the gyro, integrated, is the 3.60 rad of the data's description.
    yaw = np.trapezoid(log.imu.angular_velocities[:, 2], log.imu.stamps)
    assert yaw == pytest.approx(3.60, abs=0.02)


def test_the_husky(data_dir):
    log = read_bag(data_dir / "bags" / "husky.bag")
    assert log.scans is None
    assert log.odometry.topic == "/husky_velocity_controller/odom"
    assert (log.odometry.stamps.size, log.imu.stamps.size, log.fixes.stamps.size) == (
        3952,
        11865,
        989,
    )
    # Mounted rotated: gravity is on the y axis, and nothing in the bag says so.
    assert log.imu.linear_accelerations[:, 1].mean() == pytest.approx(9.8, abs=0.3)
    assert not log.imu.mounting_known
