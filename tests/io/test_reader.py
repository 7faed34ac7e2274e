"""One reader for all: what goes where, and the summary of a log."""

import dataclasses
import gzip
import shutil

import numpy as np
import pytest

from jaxslam.io import LogError, SensorLog, read_log, summarize
from jaxslam.io.log import FixTrack, ImuTrack, JointTrack, OdometryTrack, ScanTrack

LINE = b"FLASER 2 1.0 81.83 0 0 0 0 0 0 1.0 host 1.0\n"


@pytest.mark.parametrize("name", ["a.log", "a.clf", "a.carmen"])
def test_carmen_logs_are_recognized_by_suffix(tmp_path, name):
    (tmp_path / name).write_bytes(LINE)
    assert read_log(tmp_path / name).scans.topic == "FLASER"


@pytest.mark.parametrize("name", ["a.clf.gz", "a.gz", "a", "a.log"])
def test_gzip_is_recognized_by_content(tmp_path, name):
    (tmp_path / name).write_bytes(gzip.compress(LINE))
    assert read_log(str(tmp_path / name)).scans.topic == "FLASER"


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.txt", b"hello", r"unknown kind of log: expected a CARMEN log \(\.log, \.clf"),
        ("a.png", b"\x89PNG", "a ROS 1 bag .*a ROS 2 bag"),
        ("a.bag", b"hello", "is not a bag"),
        ("a.mcap", b"", "is empty"),
        ("a.log", b"", "is empty"),
    ],
)
def test_other_files_are_errors(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(LogError, match=message):
        read_log(tmp_path / name)


def test_missing_files_and_folders_are_errors(tmp_path):
    with pytest.raises(LogError, match="no such file"):
        read_log(tmp_path / "none.log")
    with pytest.raises(LogError, match=r"no metadata\.yaml"):
        read_log(tmp_path)


def test_topics_are_refused_where_there_are_none(tmp_path):
    (tmp_path / "a.log").write_bytes(LINE)
    with pytest.raises(LogError, match="a CARMEN log has no topics: leave out scan_topic='/scan'"):
        read_log(tmp_path / "a.log", scan_topic="/scan")


def test_bags_are_recognized_and_topics_passed_on(tmp_path, data_dir):
    shutil.copy(data_dir / "calibration" / "turtlebot3_wall_0.5m.mcap", tmp_path / "a.mcap")
    assert read_log(tmp_path / "a.mcap", scan_topic="scan").scans.stamps.size == 289
    with pytest.raises(LogError, match="no topic '/odm'"):
        read_log(tmp_path / "a.mcap", odometry_topic="/odm")
    # A ROS 1 bag is one by its content, whatever its name.
    shutil.copy(data_dir / "bags" / "husky.bag", tmp_path / "renamed.data")
    with pytest.raises(LogError, match="no topic '/scan'"):
        read_log(tmp_path / "renamed.data", scan_topic="/scan")


# --- summary --------------------------------------------------------------------------------


@pytest.fixture
def full_log(tmp_path):
    stamps = np.array([0.0, 0.1, 0.2, 0.3, 2.3])
    theta = np.array([0, 1, 2, 3, 4]) * 1.0
    poses = np.stack([np.arange(5.0), np.zeros(5), theta], axis=1)
    ranges = np.ones((5, 4), dtype=np.float32)
    ranges[:, 3] = np.nan
    nan3 = np.full((5, 3), np.nan)
    return SensorLog(
        tmp_path / "a.mcap",
        OdometryTrack(stamps, poses, nan3, "/odom"),
        ImuTrack(stamps, np.full((5, 4), np.nan), np.ones((5, 3)), nan3, np.eye(3), False, "/imu"),
        JointTrack(stamps, ("left", "right"), np.ones((5, 2)), np.ones((5, 2)), "/joint_states"),
        FixTrack(stamps, np.array([[45.0, 9.0 + 1e-4 * i, 0.0] for i in range(5)]), "/fix"),
        ScanTrack(
            stamps,
            ranges,
            np.array([3, 4, 4, 4, 4]),
            np.full(5, -0.5),
            np.full(5, np.deg2rad(2.0)),
            0.1,
            8.0,
            np.array([0.2, 0.0, np.pi]),
            False,
            "/scan",
        ),
        ("a warning " * 20,),
        {"/scan": 5, "/odom": 5, "/camera": 7},
    )


def test_the_summary_says_what_is_there(full_log):
    text = summarize(full_log)
    # 15 returns of 19 beams; four steps of 1 rad are 229°; 4e-4° of longitude at 45° are 31 m.
    for expected in (
        "5 scans on /scan, 2.3 s, 1.74 Hz",
        "3 to 4 beams, 2.000° apart",
        "over 4.0 to 6.0°",
        "sensor 0.1 to 8 m; measured 1.00 to 1.00 m, median 1.00 m; 78.9%",
        "lidar at x 0.200 m, y 0.000 m, heading 180.0° (assumed: not in the log)",
        "gaps: 2 s after 0.3 s",
        "path 4.0 m, net rotation 229°, extent 4.0 × 0.0 m, no velocities",
        "angular velocity; mounting not in the log",
        "left, right",
        "extent 31 m east × 0 m north",
        "not used      /camera (7)",
        "warnings      - a warning",
    ):
        assert expected in text, expected
    assert max(len(line) for line in text.splitlines()) <= 100


def test_an_empty_log_has_a_summary(tmp_path):
    text = summarize(SensorLog(tmp_path))
    assert [line.split(None, 1)[0] for line in text.splitlines()[1:]] == [
        *("scans", "odometry", "not", "warnings")
    ]


def test_real_logs_are_summarized_in_a_hundred_columns(data_dir):
    for name in ("carmen/wean_robotdata1.clf.gz", "bags/turtlebot3_drive.mcap"):
        lines = summarize(read_log(data_dir / name)).splitlines()
        assert max(len(line) for line in lines[1:]) <= 100


# --- a part of a log --------------------------------------------------------------------------


def test_a_part_of_a_log_has_what_was_recorded_then(full_log):
    part = full_log.between(0.1, 0.25)
    for name in ("odometry", "imu", "joints", "fixes", "scans"):
        np.testing.assert_array_equal(getattr(part, name).stamps, [0.1, 0.2])
    np.testing.assert_array_equal(part.odometry.poses, full_log.odometry.poses[1:3])
    np.testing.assert_array_equal(part.scans.ranges, full_log.scans.ranges[1:3])
    assert part.scans.num_beams.tolist() == [4, 4]
    # What is mounted stays where it is.
    np.testing.assert_array_equal(part.scans.pose_base_lidar, full_log.scans.pose_base_lidar)
    np.testing.assert_array_equal(part.imu.rotation_base_imu, np.eye(3))
    assert part.joints.names == ("left", "right")
    assert (part.path, part.warnings) == (full_log.path, full_log.warnings)


def test_both_ends_of_a_part_belong_to_it(full_log):
    np.testing.assert_array_equal(full_log.between(0.3, np.inf).scans.stamps, [0.3, 2.3])
    # Times are counted from the first scan, whatever was recorded before it.
    late = dataclasses.replace(full_log, scans=full_log.between(0.2, 3.0).scans)
    np.testing.assert_array_equal(late.between(0.0, 0.0).odometry.stamps, [0.2])
    without = dataclasses.replace(full_log, odometry=None)
    assert without.between(0.0, 1.0).odometry is None


@pytest.mark.parametrize(
    ("start", "end", "complaint"),
    [
        (0.5, 2.0, r"no scan from 0.5 to 2.0 s: scans are from 0 to 2.3 s"),
        (3.0, np.inf, "no scan from 3.0 to inf s"),
        (0.3, 0.1, "no scan from 0.3 to 0.1 s"),
        (np.nan, 1.0, "no scan from nan to 1.0 s"),
    ],
)
def test_a_part_without_scans(full_log, start, end, complaint):
    with pytest.raises(LogError, match=complaint):
        full_log.between(start, end)


def test_a_log_without_scans_has_no_parts(tmp_path):
    with pytest.raises(LogError, match="has no scans"):
        SensorLog(tmp_path).between(0.0, 1.0)
