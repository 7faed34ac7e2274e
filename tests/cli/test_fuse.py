"""`jaxslam fuse` on real bags, and on logs that it cannot use."""

import json

import numpy as np
import pytest

from jaxslam.cli.main import main
from jaxslam.io import read_tum
from tests.checks import error_line


def test_husky_against_gps(data_dir, tmp_path, capsys):
    assert main(["fuse", str(data_dir / "bags/husky.bag"), "--gps", "--out", str(tmp_path)]) == 0
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    # Wheel speed with the gyro's yaw, unfiltered, ends at 3.29 m.
    assert metrics["gps"]["rmse_m"] < 3.29 < metrics["gps_odometry_alone"]["rmse_m"]
    assert metrics["gps"]["n"] == 989
    assert metrics["imu_axis"] == [0, 1, 0]
    assert metrics["imu_axis_from"] == "gravity"
    assert metrics["rates_hz"]["imu"] == pytest.approx(30, abs=1)
    stamps, poses = read_tum(tmp_path / "trajectory.tum")
    assert len(stamps) == len(poses) == 3952
    assert np.isfinite(poses).all()
    assert (tmp_path / "sigma.png").stat().st_size > 10_000
    assert "2." in capsys.readouterr().out


def test_each_log_has_its_own_default_folder(data_dir, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("husky.bag", "turtlebot3_drive.mcap"):
        assert main(["fuse", str(data_dir / "bags" / name)]) == 0
    found = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("trajectory.tum")}
    assert found == {f"runs/{name}-fuse/trajectory.tum" for name in ("husky", "turtlebot3_drive")}


def test_wheel_angles_are_a_source(data_dir, tmp_path):
    bag = str(data_dir / "bags/turtlebot3_drive.mcap")
    assert main(["fuse", bag, "--wheel-radius", "0.033", "--track", "0.16", "--out", str(tmp_path)]) == 0
    _, poses = read_tum(tmp_path / "trajectory.tum")
    # Out and back: net yaw by the gyro 3.60 rad, by the wheels 3.92.
    net = np.unwrap(poses[:, 2])[-1] - poses[0, 2]
    assert abs(net - 3.60) < abs(net - 3.92)


def test_a_map_from_fused_odometry(data_dir, tmp_path):
    bag, small = str(data_dir / "bags/turtlebot3_drive.mcap"), ["--particles", "3", "--set", "window=4"]
    assert main(["run", bag, "--fuse", *small, "--out", str(tmp_path)]) == 0
    run = json.loads((tmp_path / "run.json").read_text())
    assert run["configuration"]["fusion.use"] == "on"
    assert run["fused"]["readings"]["imu"] == 1256
    assert (tmp_path / "map.png").exists()


def test_a_log_without_imu_cannot_be_mapped_fused(data_dir, tmp_path, capsys):
    log = str(data_dir / "carmen/csail.clf.gz")
    assert main(["run", log, "--fuse", "--out", str(tmp_path / "new")]) == 2
    assert "no IMU in it" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_an_axis_without_fusing_is_refused(data_dir, capsys):
    assert main(["run", str(data_dir / "bags/turtlebot3_drive.mcap"), "--imu-yaw-axis", "y"]) == 2
    assert "--imu-yaw-axis has no effect without fusion" in capsys.readouterr().err


def test_a_printed_configuration_has_the_lidar_only_if_it_was_asked_for(capsys):
    def printed(*flags):
        assert main(["config", *flags]) == 0
        return capsys.readouterr().out

    assert "[lidar]" not in printed()
    assert "usable_range = 3.0" in printed("--set", "usable_range=3")
    assert 'name = "lds-01"' in printed("--lidar", "lds-01")


@pytest.mark.parametrize(
    ("log", "flags", "message"),
    [
        ("carmen/csail.clf.gz", [], "no IMU in it, so there is nothing to fuse"),
        ("bags/turtlebot3_drive.mcap", ["--gps"], "no GPS fix in it"),
        ("bags/husky.bag", ["--imu-yaw-axis", "w"], "yaw_axis is 'w', must be one of auto, x, y, z"),
        ("bags/turtlebot3_drive.mcap", ["--track", "0.16"], "--wheel-radius and --track go together"),
        ("bags/husky.bag", ["--track", "1", "--wheel-radius", "1"], "no wheel angles"),
        ("bags/turtlebot3_drive.mcap", ["--track", "0", "--wheel-radius", "1"], "the track is 0.0 m"),
    ],
)
def test_what_cannot_be_fused_is_one_line(data_dir, tmp_path, capsys, log, flags, message):
    assert main(["fuse", str(data_dir / log), *flags, "--out", str(tmp_path)]) == 2
    assert message in error_line(capsys)
