"""CARMEN logs: hand-written lines with known content, every kind of damage, and the real logs."""

import gzip

import numpy as np
import pytest

from jaxslam.io import LogError, read_carmen

HALF_PI = np.pi / 2


def odometry(t, x=0.0, y=0.0, theta=0.0, tv=0.0, rv=0.0, ipc=None):
    return f"ODOM {x} {y} {theta} {tv} {rv} 0 {t if ipc is None else ipc} host {t}"


def flaser(t, ranges, pose=(0.0, 0.0, 0.0), pose_laser=None, ipc=None):
    numbers = [*ranges, *(pose if pose_laser is None else pose_laser), *pose]
    text = " ".join(map(str, numbers))
    return f"FLASER {len(ranges)} {text} {t if ipc is None else ipc} host {t}"


def robot_laser(t, ranges, geometry="-1.570796 3.141593 0.017453 5.6", pose=(0.0,) * 3, laser=None):
    poses = " ".join(map(str, (*(pose if laser is None else laser), *pose)))
    values = " ".join(map(str, ranges))
    return (
        f"ROBOTLASER1 0 {geometry} 0.01 0 {len(ranges)} {values} 0 {poses} 0 0 0.2 0.2 1000000 {t} host {t}"
    )


@pytest.fixture
def read(tmp_path):
    def write_and_read(*lines, name="a.log", end="\n"):
        path = tmp_path / name
        path.write_text("\n".join(lines) + end)
        return read_carmen(path)

    return write_and_read


def test_flaser_and_odometry_are_read_as_written(read):
    log = read(
        "# a comment",
        "PARAM robot_frontlaser_offset 0.25 0 host 0",
        odometry(1.0, 1.0, 2.0, 0.5, tv=0.3, rv=-0.1),
        flaser(1.5, [1.0, 2.0, 81.91], (1.1, 2.1, 0.6)),
        odometry(2.0, 1.2, 2.2, 0.7, tv=0.4),
        flaser(2.5, [0.0, 3.0, 4.0], (1.3, 2.3, 0.8)),
    )
    np.testing.assert_array_equal(log.scans.stamps, [1.5, 2.5])
    expected = np.array([[1, 2, np.nan], [np.nan, 3, 4]], dtype=np.float32)
    np.testing.assert_array_equal(log.scans.ranges, expected)
    np.testing.assert_allclose(log.scans.pose_base_lidar, [0.25, 0, 0])
    assert log.scans.mounting_known
    np.testing.assert_array_equal(log.odometry.stamps, [1.0, 1.5, 2.0, 2.5])
    np.testing.assert_allclose(log.odometry.poses[1], [1.1, 2.1, 0.6])
    np.testing.assert_allclose(log.odometry.twists[0], [0.3, 0.0, -0.1])
    assert np.isnan(log.odometry.twists[1]).all()
    assert log.topics == {"PARAM": 1, "ODOM": 2, "FLASER": 2}
    assert log.warnings == ()


@pytest.mark.parametrize(
    ("beams", "parameters", "first", "last"),
    [
        (181, [], -90, 90),
        (180, [], -90, 89),
        (361, [], -90, 90),
        (360, [], -90, 89.5),
        (341, ["PARAM laser_front_laser_fov 240"], -120, 120),
        (
            540,
            ["PARAM laser_front_laser_fov 270", "PARAM laser_front_laser_resolution 0.5"],
            -135,
            134.5,
        ),
        (181, ["PARAM laser_front_laser_resolution 0.25"], -90, 90),  # Does not fit: ignored.
        (181, ["PARAM laser_front_laser_fov nonsense"], -90, 90),
    ],
)
def test_flaser_beam_angles(read, beams, parameters, first, last):
    scans = read(*parameters, flaser(0.0, np.ones(beams))).scans
    assert np.rad2deg(scans.angle_min[0]) == pytest.approx(first)
    end = scans.angle_min[0] + (beams - 1) * scans.angle_increment[0]
    assert np.rad2deg(end) == pytest.approx(last)


@pytest.mark.parametrize(
    ("geometry", "count", "increment"),
    [
        ("-1.570796 3.141593 0.017453 5.6", 181, 3.141593 / 180),  # The rounded step, exact again.
        ("-1.570796 3.141593 0.008727 5.6", 360, 3.141593 / 360),
        ("-1.570796 3.141593 0.0175 5.6", 170, 0.0175),  # Another step than the ends imply.
        ("-1.570796 3.141593 0 5.6", 181, 3.141593 / 180),  # None.
        ("-1.570796 3.141593 1.0 5.6", 181, 3.141593 / 180),  # In degrees by mistake.
    ],
)
def test_robot_laser_beam_angles(read, geometry, count, increment):
    scans = read(robot_laser(0.0, np.ones(count), geometry)).scans
    assert scans.angle_min[0] == -1.570796
    assert scans.angle_increment[0] == pytest.approx(increment, abs=1e-12)


def test_robot_laser_says_everything_itself(read):
    lasers = [
        robot_laser(t, [1.0, 5.6, 0.007, 2.0], pose=(t, 0.0, HALF_PI), laser=(t, 0.145, HALF_PI))
        for t in range(3)
    ]
    log = read(*lasers)
    scans = log.scans
    assert scans.range_max == 5.6
    # 5.6 is no return, 7 mm is an error code of the sensor.
    assert np.isfinite(scans.ranges[0]).tolist() == [True, False, False, True]
    np.testing.assert_allclose(scans.pose_base_lidar, [0.145, 0, 0], atol=1e-6)
    assert scans.mounting_known
    assert log.odometry.topic == "ROBOTLASER1"
    np.testing.assert_allclose(log.odometry.poses[:, 0], [0, 1, 2])


def test_raw_laser_takes_the_odometry_of_odom_lines(read):
    raw = "RAWLASER1 0 -1.570796 3.141593 1.570796 8.0 0.01 0 3 1 2 3 2 7 7 0.5 host 0.5"
    log = read(odometry(0.0), odometry(1.0, 1.0), raw)
    assert log.scans.topic == "RAWLASER1"
    assert log.scans.ranges.tolist() == [[1, 2, 3]]
    assert not log.scans.mounting_known
    assert log.odometry.topic == "ODOM"
    assert log.odometry.stamps.tolist() == [0, 1]


def test_of_two_laser_messages_the_richer_is_used(read):
    raw = "RAWLASER1 0 -1.570796 3.141593 1.570796 8.0 0.01 0 1 9 0 {0} host {0}"
    log = read(raw.format(0), robot_laser(0.1, [1.0]), raw.format(1), raw.format(2), robot_laser(2, [1]))
    assert log.scans.topic == "ROBOTLASER1"
    assert log.topics["RAWLASER1"] == 3


def test_other_messages_are_counted(read):
    rear = flaser(0.5, [1.0]).replace("FLASER", "RLASER")
    log = read(flaser(0.0, [1.0]), rear, rear, "SYNC tag 0 host 0")
    assert (log.topics["RLASER"], log.topics["SYNC"]) == (2, 1)
    assert not any("RLASER" in line for line in log.warnings)


def test_a_changing_number_of_beams_is_padded(read):
    scans = read(flaser(0, [1.0] * 180), flaser(1, [1.0] * 181), flaser(2, [1.0] * 90)).scans
    assert scans.ranges.shape == (3, 181)
    assert scans.num_beams.tolist() == [180, 181, 90]
    assert np.isfinite(scans.ranges).sum(axis=1).tolist() == [180, 181, 90]
    np.testing.assert_allclose(np.rad2deg(scans.angle_increment), [1, 1, 2])


# --- maximum range and mounting -------------------------------------------------------------


def test_maximum_range_is_the_smallest_that_is_stated(read):
    assert read("PARAM robot_front_laser_max 20", flaser(0, [81.91, 25])).scans.range_max == 20
    # The field says 81.92, but a SICK's code 81.91 is no return either.
    log = read(robot_laser(0, [81.91, 2.0], "-1.570796 3.141593 1.570796 81.92"))
    assert log.scans.range_max == pytest.approx(81.825)


@pytest.mark.parametrize(("largest", "expected"), [(7.0, 8.1825), (30.0, 81.825)])
def test_a_maximum_range_that_nothing_tells_is_a_warning(read, largest, expected):
    log = read(flaser(0, [1.0, largest]))
    assert log.scans.range_max == pytest.approx(expected)
    assert np.isfinite(log.scans.ranges).all()
    assert "maximum range" in log.warnings[0]


def test_unknown_mounting_is_marked(read):
    scans = read(flaser(0, [1.0], (1.0, 2.0, 3.0))).scans
    assert not scans.mounting_known
    assert scans.pose_base_lidar.tolist() == [0, 0, 0]


def test_corrected_laser_poses_are_no_mounting(read):
    lines = [flaser(t, [1.0, 81.83], (t, 0.0, 0.0), (t, 0.1 * t * t, 0.0)) for t in range(8)]
    log = read("PARAM robot_frontlaser_offset 0.1", *lines)
    np.testing.assert_allclose(log.scans.pose_base_lidar, [0.1, 0, 0])
    assert "do not differ by a fixed mounting" in log.warnings[0]


def test_mounting_heading_at_half_a_turn_is_a_circular_median(read):
    headings = (3.141592, -3.141592, 3.141591)
    lines = [flaser(t, [1.0], (0, 0, 0), (0.2, 0, heading)) for t, heading in enumerate(headings)]
    pose = read(*lines).scans.pose_base_lidar
    assert pose[0] == 0.2
    assert abs(pose[2]) == pytest.approx(np.pi, abs=1e-5)


# --- time and odometry ----------------------------------------------------------------------


def test_jitter_is_sorted_and_counted(read):
    log = read(flaser(0.0, [1.0]), flaser(0.3, [3.0]), flaser(0.2, [2.0]), flaser(0.4, [4.0]))
    assert log.scans.ranges[:, 0].tolist() == [1, 2, 3, 4]
    assert any("FLASER: 1 stamps run backwards by up to 0.100 s" in line for line in log.warnings)


def test_a_clock_that_is_set_back_is_an_error_with_its_line(read):
    with pytest.raises(LogError, match=r"run backwards by 99\.0 s at line 3: cut the log there"):
        read(flaser(0.0, [1.0]), flaser(100.0, [1.0]), flaser(1.0, [1.0]))


def test_logger_stamps_replace_useless_ipc_stamps(read):
    log = read(*(flaser(t, [1.0], ipc=0.0) for t in (5.0, 6.0, 7.0)))
    assert log.scans.stamps.tolist() == [5, 6, 7]
    assert any("all ipc stamps are 0" in line for line in log.warnings)
    log = read(*(flaser(t, [1.0], ipc=ipc) for t, ipc in ((5.0, 100.0), (6.0, 20.0))))
    assert log.scans.stamps.tolist() == [5, 6]


def test_computers_with_different_clocks_fall_back_to_the_logger(read):
    log = read(*(odometry(t, t, ipc=t + 50.0) for t in (0.0, 1.0, 2.0)), flaser(1.0, [1.0], (1, 0, 0)))
    assert log.odometry.stamps.tolist() == [0, 1, 2]
    assert any("clocks are 50.0 s apart" in line for line in log.warnings)


def test_ipc_stamps_are_preferred(read):
    assert read(flaser(1.0, [1.0], ipc=1e9), flaser(2.0, [1.0], ipc=1e9 + 1)).scans.stamps[0] == 1e9


def test_repeated_stamps_are_spread_and_doubled_scans_dropped(read):
    log = read(
        flaser(0.0, [1.0]),
        flaser(1.0, [2.0]),
        flaser(1.0, [3.0]),
        flaser(2.0, [4.0]),
        flaser(2.0, [4.0]),
    )
    assert log.scans.stamps.tolist() == [0, 1, 1.5, 2]
    assert log.odometry.stamps.tolist() == [0, 1, 1.5, 2]
    assert any(line.startswith("1 scans have the stamp") for line in log.warnings)
    assert any("1 FLASER lines recorded twice" in line for line in log.warnings)


def test_odometry_lines_on_another_time_are_left_out(read):
    # The scans' poses lag the ODOM lines by 0.1 s, at 1 m/s: 0.1 m.
    lines = [odometry(t / 10, t / 10) for t in range(30)]
    scans = [flaser(t + 0.05, [1.0, 81.83], (t - 0.05, 0, 0)) for t in range(3)]
    log = read(*lines, *scans)
    assert log.odometry.topic == "FLASER"
    assert "they are 100 mm (median) off" in log.warnings[0]


def test_velocities_of_odom_lines_hold_for_the_scan_with_the_same_stamp(read):
    log = read(
        odometry(0, 0, tv=0.5),
        flaser(0, [1.0]),
        odometry(1, 1, tv=0.6),
        flaser(1, [1.0], (1, 0, 0)),
    )
    np.testing.assert_allclose(log.odometry.twists, [[0.5, 0, 0], [0.6, 0, 0]])


def test_velocities_that_are_always_zero_are_absent(read):
    assert np.isnan(read(odometry(0), odometry(1, 1.0)).odometry.twists).all()
    assert (read(odometry(0), odometry(1)).odometry.twists == 0).all()


def test_scans_with_dead_poses_take_the_odometry_lines(read):
    log = read(odometry(0), odometry(1, 1.0), odometry(2, 2.0), flaser(0.5, [1.0]), flaser(1.5, [1.0]))
    assert log.odometry.topic == "ODOM"
    assert any("never change" in line for line in log.warnings)


def test_a_log_without_one_of_the_two_is_read(read):
    log = read(odometry(0), odometry(1))
    assert log.scans is None
    raw = "RAWLASER1 0 -1.570796 3.141593 1.570796 8.0 0.01 0 1 9 0 {0} host {0}"
    log = read(raw.format(0), raw.format(1))
    assert log.odometry is None
    assert log.scans.stamps.size == 2


# --- bad input ------------------------------------------------------------------------------


def test_damaged_lines_are_skipped_and_counted(read):
    good = flaser(0.0, [1.0, 2.0, 3.0])
    log = read(
        good,
        good[:25],
        "FLASER x 1 2",
        "FLASER -1 0 0 0 0 0 0 0 h 0",
        "ODOM nan 0 0 0 0 0 0 host 0",
        odometry(1.0),
        "%% no message",
        *(flaser(t, [1.0, 2.0, 3.0]) for t in range(1, 9)),
    )
    assert log.scans.stamps.size == 9
    assert "5 damaged lines skipped, the first is line 2" in log.warnings


def test_a_file_that_ends_in_a_line_says_so(read):
    log = read(flaser(0.0, [1.0]), flaser(1.0, [1.0]), "FLASER 3 1.0 2", end="")
    assert log.scans.stamps.size == 2
    assert any("ends in the middle of a line" in line for line in log.warnings)


def test_useless_readings_become_no_return(read):
    log = read(flaser(0.0, ["nan", "inf", "-1", "-inf", 2.0, 0.0]))
    assert np.isfinite(log.scans.ranges[0]).tolist() == [False] * 4 + [True, False]
    assert "4 readings are negative or not finite: taken as no return" in log.warnings


def test_scans_without_any_return_are_a_warning(read):
    assert any("no scan has a return" in line for line in read(flaser(0, [0.0, 81.83])).warnings)


def test_scans_without_beams_are_skipped(read):
    log = read(flaser(0, []), flaser(1, [1.0]))
    assert log.scans.stamps.tolist() == [1]
    assert any("1 FLASER lines without beams" in line for line in log.warnings)


def test_a_cut_gzip_file_is_an_error_that_helps(tmp_path):
    path = tmp_path / "a.clf.gz"
    rng = np.random.default_rng(0)
    lines = "\n".join(flaser(t, rng.uniform(1, 9, 180).round(2)) for t in range(50))
    path.write_bytes(gzip.compress(lines.encode()))
    assert read_carmen(path).scans.stamps.size == 50
    path.write_bytes(path.read_bytes()[:-5000])
    with pytest.raises(LogError, match=r"cut short .* after \d+ good lines with \d+ scans") as error:
        read_carmen(path)
    assert "gzip -dc a.clf.gz > a.clf" in str(error.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (gzip.compress(b"", mtime=0), "is empty"),
        (bytes(range(256)) * 8, "not a text file"),
        (b"\x80\x81 garbage\n\xff\xfe\n", "0 usable messages and 2 damaged lines"),
        (b"hello world\n", "expected a CARMEN log"),
        (b"SYNC a 0 h 0\n", "0 usable messages"),
        (b"\x1f\x8b\x08\x00 no gzip", "cut short or damaged"),
    ],
)
def test_what_is_no_log_is_an_error(tmp_path, content, message):
    path = tmp_path / "a.log"
    path.write_bytes(content)
    with pytest.raises(LogError, match=message) as error:
        read_carmen(path)
    assert "\n" not in str(error.value)


def test_missing_files_and_folders_are_errors(tmp_path):
    with pytest.raises(LogError, match="no such file"):
        read_carmen(tmp_path / "none.log")
    with pytest.raises(LogError, match="is a folder"):
        read_carmen(tmp_path)


# --- the real logs --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "shape", "first", "step", "range_max", "x", "known"),
    [
        ("intel", (2691, 180), -90, 1.0, 81.825, 0.0, True),
        ("csail", (406, 361), -90, 0.5, 81.825, 0.0, True),
        ("aces_semireal", (440, 180), -90, 1.0, 50.0, 0.0, True),
        ("mines_exp1", (756, 682), -120, 240 / 681, 5.6, 0.145, True),
        ("rover5_6aug14", (3936, 360), -180, 1.0, 6.0, -0.035, True),
        ("dpslam_loop5", (551, 181), -90, 1.0, 8.1825, 0.0, False),
        ("wean_robotdata1", (713, 180), -90, 1.0, 81.825, 0.25, True),
    ],
)
def test_real_logs(data_dir, name, shape, first, step, range_max, x, known):
    log = read_carmen(data_dir / "carmen" / f"{name}.clf.gz")
    scans = log.scans
    assert scans.ranges.shape == shape
    assert np.rad2deg(scans.angle_min[0]) == pytest.approx(first, abs=1e-4)
    assert np.rad2deg(scans.angle_increment[0]) == pytest.approx(step, abs=1e-5)
    assert scans.range_max == pytest.approx(range_max)
    np.testing.assert_allclose(scans.pose_base_lidar, [x, 0, 0], atol=1e-6)
    assert scans.mounting_known == known
    assert (np.diff(scans.stamps) > 0).all()
    assert (np.diff(log.odometry.stamps) > 0).all()
    assert np.isin(scans.stamps, log.odometry.stamps).all()
