"""TUM trajectories and relations: round trips, `evo` as the second reader, bad lines."""

import numpy as np
import pytest
from evo.tools import file_interface
from scipy.spatial.transform import Rotation

from jaxslam.io import LogError, read_relations, read_tum, write_tum


@pytest.fixture
def trajectory():
    rng = np.random.default_rng(0)
    stamps = 1134864642.914187 + np.cumsum(rng.uniform(0.1, 1, 40))
    poses = rng.uniform([-100, -100, -np.pi], [100, 100, np.pi], (40, 3))
    return stamps, poses


def test_what_is_written_is_read_back(tmp_path, trajectory):
    stamps, poses = trajectory
    write_tum(tmp_path / "a.tum", stamps, poses, comment="seed 3\nmethod rbpf")
    assert (tmp_path / "a.tum").read_text().startswith("# seed 3\n# method rbpf\n# timestamp")
    stamps_read, poses_read = read_tum(tmp_path / "a.tum")
    np.testing.assert_allclose(stamps_read, stamps, rtol=0, atol=1e-6)
    np.testing.assert_allclose(poses_read, poses, rtol=0, atol=1e-6)


def test_evo_reads_what_is_written(tmp_path, trajectory):
    stamps, poses = trajectory
    write_tum(tmp_path / "a.tum", stamps, poses)
    other = file_interface.read_tum_trajectory_file(tmp_path / "a.tum")
    np.testing.assert_allclose(other.timestamps, stamps, rtol=0, atol=1e-6)
    np.testing.assert_allclose(other.positions_xyz[:, :2], poses[:, :2], atol=1e-6)
    yaw = [np.arctan2(pose[1, 0], pose[0, 0]) for pose in other.poses_se3]
    np.testing.assert_allclose(yaw, poses[:, 2], atol=1e-6)


def test_a_trajectory_in_space_is_projected(tmp_path):
    quaternion = Rotation.from_euler("ZYX", [0.7, 0.1, -0.2]).as_quat()
    text = "# comment\n\n1.5, 1, 2, 3, " + ", ".join(map(str, quaternion)) + "\n"
    (tmp_path / "a.tum").write_text(text)
    stamps, poses = read_tum(tmp_path / "a.tum")
    assert stamps.tolist() == [1.5]
    np.testing.assert_allclose(poses, [[1, 2, 0.7]])


def test_poses_that_are_not_finite_are_not_written(tmp_path):
    with pytest.raises(ValueError, match="pose 1 of the trajectory is not finite"):
        write_tum(tmp_path / "a.tum", np.arange(3.0), np.array([[0, 0, 0], [0, np.nan, 0], [1, 1, 1.0]]))
    assert not (tmp_path / "a.tum").exists()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "has no data"),
        ("# only a comment\n", "has no data"),
        ("0 0 0 0 0 0 0 1\n1 0 0 0 0 0 0\n", r"\.tum:2: 7 fields, not 8"),
        ("0 0 0 0 0 0 0 1\n\n1 0 x 0 0 0 0 1\n", r"\.tum:3: not a number"),
        ("0 0 nan 0 0 0 0 1\n", r"\.tum:1: a value is not finite"),
        ("0 0 0 0 0 0 0 0\n", r"\.tum:1: the quaternion is zero"),
    ],
)
def test_bad_trajectories_name_the_line(tmp_path, text, message):
    (tmp_path / "a.tum").write_text(text)
    with pytest.raises(LogError, match=message):
        read_tum(tmp_path / "a.tum")


def test_unreadable_files_are_errors(tmp_path):
    with pytest.raises(LogError, match="no such file"):
        read_tum(tmp_path / "none.tum")
    with pytest.raises(LogError, match="cannot be read"):
        read_tum(tmp_path)
    (tmp_path / "a.tum").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(LogError, match="not a text file"):
        read_tum(tmp_path / "a.tum")


def test_relations_are_read(tmp_path):
    (tmp_path / "a.relations").write_text("# t1 t2 …\n15.0 21.8 -0.05 -0.12 9 8 7 4.0\n")
    relations = read_relations(tmp_path / "a.relations")
    assert relations.stamps_from.tolist() == [15.0]
    assert relations.stamps_to.tolist() == [21.8]
    np.testing.assert_allclose(relations.deltas, [[-0.05, -0.12, 4.0 - 2 * np.pi]])


def test_bad_relations_name_the_line(tmp_path):
    (tmp_path / "a.relations").write_text("15.0 21.8 -0.05\n")
    with pytest.raises(LogError, match=r"\.relations:1: 3 fields, not 8: expected 't1 t2 x y z"):
        read_relations(tmp_path / "a.relations")


@pytest.mark.parametrize("text", ["0 1 2 0 0 0 0 1.5\n1 2 2 0 0 0 0 0\n", "9.5 9.7 1 0 0 0 0 -2\n"])
def test_relations_are_no_trajectory(tmp_path, text):
    (tmp_path / "a.relations").write_text(text)
    with pytest.raises(
        LogError, match="these are relations, not poses in TUM format: give them with --relat"
    ):
        read_tum(tmp_path / "a.relations")


def test_a_trajectory_is_no_relations(tmp_path, trajectory):
    write_tum(tmp_path / "a.tum", *trajectory)
    with pytest.raises(
        LogError, match="these are poses in TUM format, not relations: give them with --refer"
    ):
        read_relations(tmp_path / "a.tum")


def test_real_references(data_dir):
    relations = read_relations(data_dir / "carmen" / "intel.relations")
    assert relations.deltas.shape == (2984, 3)
    stamps, poses = read_tum(data_dir / "carmen" / "csail.reference.tum")
    assert poses.shape == (stamps.size, 3) == (406, 3)
