"""Conversion of public logs: snippets in the sources' formats, read back by the library's own readers."""

import gzip

import numpy as np
import pytest

from jaxslam.io import LogError, read_log, read_map, read_relations, read_tum
from jaxslam.io.convert import INTEL_FIRST_STAMP, convert


def save(path, text):
    content = text.encode()
    path.write_bytes(gzip.compress(content) if path.suffix == ".gz" else content)
    return path


def test_gfs_log_chains_the_raw_motion_over_corrections_and_times_by_reading(tmp_path):
    # After the scan the corrected pose is 0.1 m behind and turned by 90°; the next motion is 0.5 m forward.
    log = save(
        tmp_path / "intel.gfs.log",
        "ODOM 0 0 0 0 0 0 0.000246 pippo 0.000246\n"
        "ODOM 1 0 0 0 0 0 0.3 pippo 0.3\n"
        "FLASER 3 1.09 81.83 2 0.9 0 1.570796 0.9 0 1.570796 0.3 pippo 0.3\n"
        "ODOM 0.9 0 1.570796 0 0 0 0 pippo 0\n"
        "NEFF 15\n"
        "ODOM 0.9 0.5 1.570796 0 0 0 0.2 pippo 0.2\n"  # Stamps jitter and run backwards.
        "FLASER 3 1.1 81.83 2 0.95 0.5 1.6 0.95 0.5 1.6 0.2 pippo 0.2\n"
        "ODOM 0.95 0.5 1.6 0 0 0 0 pippo 0\n",
    )
    stamp = [f"{INTEL_FIRST_STAMP + t:.6f}" for t in (0.000246, 0.3, 0.2)]
    relations = save(
        tmp_path / "intel.relations",
        f"{stamp[0]} {stamp[1]} 1.0 0 0 0 0 0.1\n{stamp[1]} {stamp[2]} 0.5 0 0 0 0 -0.1\n",
    )
    written = convert("gfs_log", "intel", [log, relations], tmp_path)
    assert [path.name for path in written] == ["intel.clf.gz", "intel.relations"]
    read = read_log(written[0])
    np.testing.assert_allclose(read.odometry.stamps, [0.0, 0.2, 0.4])
    np.testing.assert_allclose(read.odometry.poses, [[0, 0, 0], [1, 0, 0], [1.5, 0, 0]], atol=1e-6)
    np.testing.assert_allclose(read.scans.stamps, [0.2, 0.4])
    assert read.scans.ranges[:, 0] == pytest.approx([1.09, 1.1])
    assert np.isnan(read.scans.ranges[:, 1]).all()
    times = read_relations(written[1])
    np.testing.assert_allclose(times.stamps_from, [0.0, 0.2])
    np.testing.assert_allclose(times.stamps_to, [0.2, 0.4])
    np.testing.assert_allclose(times.deltas, [[1, 0, 0.1], [0.5, 0, -0.1]])


def test_relations_of_another_log_are_refused(tmp_path):
    log = save(tmp_path / "a.log", "ODOM 0 0 0 0 0 0 0.1 h 0.1\nFLASER 1 1 0 0 0 0 0 0 0.1 h 0.1\n")
    relations = save(tmp_path / "a.relations", "5.0 6.0 1 0 0 0 0 0\n")
    with pytest.raises(LogError, match="only 0 of 1 relations"):
        convert("gfs_log", "a", [log, relations], tmp_path)


def test_gfs_keeps_raw_odometry_and_takes_the_reference_from_the_corrected_log(tmp_path):
    gfs = save(
        tmp_path / "csail.gfs",
        "PARAM particles 2\n"
        "ODOM 576.494 0.004 -1.671246 1134864642.693812\n"
        "ODO_UPDATE 2 0.1 0.0 0.5 0.0 0.1 0.0 0.5 0.0 1134864642.693812\n"
        "ODOM 576.481 -0.103 -1.487635 1134864642.914187\n"
        "LASER_READING 3 1.07 81.91 1.00 576.480680 -0.103068 -1.487635 1134864642.914187\n"
        "SM_UPDATE 2 0.154 0.068 0.5 -1.0 0.1 0.0 0.5 -1.0 \nNEFF 2\n"
        "ODOM 576.489 -0.183 -1.227025 1134864643.124182\n"
        "LASER_READING 3 1.08 81.91 1.00 576.489 -0.183 -1.227025 1134864643.124182\n",
    )
    pose = "0.154 0.068 0.562729"
    corrected = save(
        tmp_path / "c.log.gz",
        f"FLASER 3 1.07 81.91 1.00 {pose} {pose} 1134864642.914187 nohost 1134864642.914187\n",
    )
    log_path, reference = convert("gfs", "csail", [gfs, corrected], tmp_path)
    log = read_log(log_path)
    assert log.odometry.stamps[0] == 1134864642.693812
    np.testing.assert_allclose(log.odometry.poses[1], [576.48068, -0.103068, -1.487635])
    assert log.scans.ranges[:, 0] == pytest.approx([1.07, 1.08])
    stamps, poses = read_tum(reference)
    assert stamps.tolist() == [1134864642.914187]
    np.testing.assert_allclose(poses, [[0.154, 0.068, 0.562729]], atol=1e-6)


def corrected_log(path):
    lines = ["PARAM robot_frontlaser_offset 0.04 nohost 0"]
    for t in range(4):
        pose = f"{t} 1 0.5"
        lines += [
            f"ODOM {t} 7 0.5 0 0 0 {t + 50}.5 nohost {t + 50}.5",
            f"FLASER 3 1 81.91 {2 + t} {pose} {pose} {t + 50} nohost {t + 50}",
            f"ODOM {pose} 0 0 0 0 nohost 0",
            "NEFF 30 0 nohost 0",
        ]
    return save(path, "\n".join(lines) + "\n")


@pytest.mark.parametrize(("first", "kept"), [(50, True), (1031750070, False)])
def test_corrected_log_keeps_scans_and_relations_of_the_same_time(tmp_path, first, kept):
    source = tmp_path / "source"
    source.mkdir()
    log = corrected_log(source / "hall-corrected.log.gz")
    relations = save(source / "hall.relations", f"{first} {first + 2} 2 0 0 0 0 0\n")
    written = convert("corrected", "hall", [log, relations], tmp_path)
    assert [path.name for path in written] == ["hall.clf.gz", "hall.reference.tum"] + [
        "hall.relations"
    ] * kept
    read = read_log(written[0])
    assert read.odometry.topic == "FLASER"
    np.testing.assert_allclose(read.odometry.poses, [[t, 1, 0.5] for t in range(4)])
    np.testing.assert_allclose(read.scans.pose_base_lidar, [0.04, 0, 0])
    np.testing.assert_allclose(read_tum(written[1])[0], [50, 51, 52, 53])


def mines_line(stamp, left, right, ranges):
    return f"{stamp} 14710 {left} {right} {' '.join(['0'] * 20)}  {' '.join(map(str, ranges))} \n"


def test_tinyslam_ticks_become_odometry(tmp_path):
    ranges = np.zeros(682, dtype=int)
    ranges[100], ranges[200] = 2229, 7  # 7 is an error code of the sensor.
    # A wheel of 77 mm and 2000 ticks: 1000 ticks are 0.2419 m; a track of 0.33 m.
    ticks = [(29221, 25178), (30221, 26178), (30221, 27178)]
    source = save(
        tmp_path / "exp1.dat",
        "".join(mines_line(212387282 + 100000 * i, *t, ranges) for i, t in enumerate(ticks)),
    )
    (written,) = convert("tinyslam", "mines", [source], tmp_path)
    assert written.name == "mines_exp1.clf.gz"
    log = read_log(written)
    forward = 1000 * 2 * np.pi * 0.077 / 2000
    turn = forward / 0.33
    chord = forward / 2
    expected = [
        [0, 0, 0],
        [forward, 0, 0],
        [forward + chord * np.cos(turn / 2), chord * np.sin(turn / 2), turn],
    ]
    np.testing.assert_allclose(log.odometry.poses, expected, atol=2e-6)
    np.testing.assert_allclose(log.scans.stamps, [0, 0.1, 0.2])
    np.testing.assert_allclose(log.scans.pose_base_lidar, [0.145, 0, 0], atol=1e-6)
    assert log.scans.ranges.shape == (3, 682)
    assert log.scans.ranges[0, 100] == pytest.approx(2.229)
    assert np.isfinite(log.scans.ranges).sum() == 3
    assert np.isclose(log.scans.angle_min[0], -np.radians(120), atol=1e-4)


def test_tinyslam_line_of_another_length_is_refused(tmp_path):
    source = save(tmp_path / "exp1.dat", mines_line(0, 0, 0, range(680)))
    with pytest.raises(LogError, match="704 numbers, expected 706"):
        convert("tinyslam", "mines", [source], tmp_path)


def wean_files(folder):
    ranges = " ".join(str(60 + i) for i in range(180))
    laser = "25.026869 12.033328 -2.857104"
    log = save(
        folder / "robotdata2.log.gz",
        "O 49.021999 19.049999 -2.857104 0.676914\n"
        f"L 49.021999 19.049999 -2.857104 {laser} {ranges} 0.678218\n"
        "O 59.021999 19.049999 -2.857104 0.735582\n",
    )
    cells = "-1.000 0.799 0.812 \n0.323 0.401 1.000 \n"
    grid = save(
        folder / "wean.dat.gz",
        "robot_specifications->global_mapsize_x                 20\n"
        f"robot_specifications->resolution                       10\n\nglobal_map[0]: 2 3\n{cells}",
    )
    return [grid, log]


def test_wean_log_is_in_meters_and_its_map_has_x_first(tmp_path):
    log_path, map_path = convert("wean", "wean", wean_files(tmp_path), tmp_path)
    assert (log_path.name, map_path.name) == ("wean_robotdata2.clf.gz", "wean.yaml")
    log = read_log(log_path)
    assert log.scans.ranges[0, :2] == pytest.approx([0.6, 0.61])
    assert log.scans.ranges.shape == (1, 180)
    np.testing.assert_allclose(log.scans.pose_base_lidar, [0.25, 0, 0], atol=1e-5)
    np.testing.assert_allclose(log.odometry.poses[:, 0], [0.49022, 0.59022], atol=1e-6)
    known = read_map(map_path)
    assert known.resolution == 0.1
    # One line of the source is one x; the library's rows are y.
    assert known.occupied.tolist() == [[False, True], [False, False], [False, False]]
    assert known.free.tolist() == [[False, False], [False, False], [True, True]]


def test_wean_log_as_stored_by_the_source(tmp_path, data_dir):
    """The first scan of robotdata2, as the source has it, against the log made from it before."""
    expected = read_log(data_dir / "carmen/wean_robotdata2.clf.gz")
    grid = wean_files(tmp_path)[0]
    ranges = " ".join(f"{100 * reading:.0f}" for reading in np.nan_to_num(expected.scans.ranges[0], nan=9000))
    log = save(
        tmp_path / "robotdata2.log.gz",
        "O 49.021999 19.049999 -2.857104 0.676914\n"
        f"L 49.021999 19.049999 -2.857104 25.026869 12.033328 -2.857104 {ranges} 0.678218\n",
    )
    converted = read_log(convert("wean", "wean", [grid, log], tmp_path)[0])
    np.testing.assert_allclose(converted.scans.ranges[0], expected.scans.ranges[0])
    np.testing.assert_allclose(converted.odometry.poses[0], expected.odometry.poses[0], atol=1e-6)
    assert converted.scans.stamps[0] == expected.scans.stamps[0]


def test_the_map_has_to_be_whole(tmp_path):
    grid, log = wean_files(tmp_path)
    save(grid, "robot_specifications->resolution 10\nglobal_map[0]: 2 3\n0 0 0\n")
    with pytest.raises(LogError, match="rows columns"):
        convert("wean", "wean", [grid, log], tmp_path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\x1f\x8b broken", "damaged"),
        (b"", "expected lines that begin with FLASER"),
        (b"FLASER 1 x y z\n", "does not have the expected format"),
    ],
)
def test_a_log_of_another_format_is_refused_in_one_line(tmp_path, content, message):
    source = tmp_path / "x.log.gz"
    source.write_bytes(content)
    with pytest.raises(LogError, match=message) as raised:
        convert("corrected", "x", [source], tmp_path)
    assert "\n" not in str(raised.value)
    assert not list(tmp_path.glob("*.part"))


def test_the_same_source_gives_the_same_bytes(tmp_path):
    log = corrected_log(tmp_path / "hall.log.gz")
    first = convert("corrected", "a", [log], tmp_path)[0].read_bytes()
    assert convert("corrected", "a", [log], tmp_path)[0].read_bytes() == first
