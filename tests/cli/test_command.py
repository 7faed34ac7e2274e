"""The `jaxslam` command, in this process: a small simulated log, and every kind of bad input."""

import gzip
import json
import math
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import jax
import numpy as np
import pytest
from PIL import Image, ImageColor

from jaxslam.cli.main import COMMANDS, main
from jaxslam.core import se2
from jaxslam.core.trajectory import interpolate_poses
from jaxslam.io import read_log, read_map, read_tum, write_tum
from jaxslam.report import default_folder, file_sha256
from jaxslam.report.folder import write_json
from jaxslam.sim import hall_small, lds_01, simulate, to_log
from jaxslam.viz import style
from tests.builders import carmen_log, forward_half
from tests.checks import error_line, strict_json


@pytest.fixture(scope="session")
def log_file(tmp_path_factory):
    """12 s of a drive past machines with a 181-beam lidar of 3.5 m, as CARMEN messages."""
    world, waypoints = hall_small()
    log = to_log(
        simulate(jax.random.key(0), world, waypoints, lidar=lds_01(), duration=12.0), start_stamp=100.0
    )
    assert log.scans is not None
    assert log.odometry is not None
    poses = interpolate_poses(log.odometry.stamps, log.odometry.poses, log.scans.stamps)
    path = tmp_path_factory.mktemp("log") / "hall.clf.gz"
    text = carmen_log(log.scans.stamps, forward_half(log.scans.ranges), poses)
    path.write_bytes(gzip.compress(text.encode()))
    return path


SMALL = ["--set", "map.resolution=0.1", "usable_range=3.0", "--map-margin", "2", "--particles", "3"]


@pytest.fixture(scope="session")
def run_folder(log_file, tmp_path_factory):
    """One whole run, with relations, reference and GIF; the other tests look at what it left."""
    folder = tmp_path_factory.mktemp("runs")
    log = read_log(log_file)
    assert log.scans is not None
    assert log.odometry is not None
    # Half-way between scans the reference is the odometry itself, so the errors must come out small.
    times = (log.scans.stamps[:-1] + log.scans.stamps[1:]) / 2
    write_tum(
        folder / "reference.tum",
        times,
        interpolate_poses(log.odometry.stamps, log.odometry.poses, times),
    )
    t1, t2 = log.scans.stamps[[2, 40]]
    (folder / "a.relations").write_text(f"{t1} {t2} 5 0 0 0 0 0\n", encoding="ascii")
    code = main(
        [
            *("run", str(log_file), "--out", str(folder / "out"), "--seed", "3", "--gif", *SMALL),
            *("--relations", str(folder / "a.relations"), "--reference", str(folder / "reference.tum")),
        ]
    )
    assert code == 0
    return folder / "out"


def test_run_folder_is_complete(run_folder):
    names = {path.name for path in run_folder.iterdir()}
    assert names == {
        *("map.pgm", "map.yaml", "map.png", "map.gif", "trajectory.tum"),
        *("run.json", "metrics.json", "config.toml", "ess.png"),
    }


def test_the_picture_has_the_reference(run_folder):
    pixels = np.asarray(Image.open(run_folder / "map.png").convert("RGB")).reshape(-1, 3)
    assert (pixels == ImageColor.getrgb(style.REFERENCE)).all(axis=1).sum() > 100


def test_a_reference_in_another_frame_is_aligned(log_file, tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(
        "jaxslam.report.folder.save_map_picture", lambda *_, truth, poses, **__: drawn.append((truth, poses))
    )
    log = read_log(log_file)
    assert log.odometry is not None
    moved = se2.compose(np.array([[100.0, -50.0, 2.0]]), log.odometry.poses)
    write_tum(tmp_path / "moved.tum", log.odometry.stamps, moved)
    flags = ["--reference", str(tmp_path / "moved.tum"), "--out", str(tmp_path), *SMALL]
    assert main(["run", str(log_file), *flags]) == 0
    [(reference, poses)] = drawn
    # The odometry of 12 s is at most a few cells off, so both paths have the same ends.
    np.testing.assert_allclose(reference[[0, -1]], poses[[0, -1]], atol=0.2)


def test_metrics_have_exactly_their_keys(run_folder):
    metrics = strict_json(run_folder / "metrics.json")
    assert set(metrics) == {
        *("scans_in", "scans_processed", "compile_s", "run_s", "ms_per_scan", "peak_rss_mb"),
        *("resamplings", "ess_mean", "relations", "ate"),
    }
    keys = {"n", "trans_mean_m", "trans_std_m", "trans_max_m", "rot_mean_deg", "rot_std_deg"}
    assert set(metrics["relations"]) == keys
    assert set(metrics["ate"]) == {"rmse_m", "max_m", "rot_rmse_deg", "n"}
    assert metrics["relations"]["n"] == 1
    assert metrics["scans_in"] == 60
    # Every gap between two scans has one reference pose.
    assert metrics["ate"]["n"] == 59
    # 12 s of slightly wrong odometry and a matched map agree within two cells of 0.1 m.
    assert metrics["ate"]["rmse_m"] < 0.2
    assert 1 < metrics["scans_processed"] < 60


def test_trajectory_has_every_scan(run_folder, log_file):
    stamps, poses = read_tum(run_folder / "trajectory.tum")
    scans = read_log(log_file).scans
    assert scans is not None
    np.testing.assert_allclose(stamps, scans.stamps, atol=1e-6)
    assert np.isfinite(poses).all()


def test_map_loads_and_shows_free_space_and_walls(run_folder):
    occupancy = read_map(run_folder / "map.yaml")
    assert occupancy.resolution == 0.1
    # The robot drives along an aisle: it frees some 3 m × 10 m, which is 3000 cells of 0.1 m.
    assert occupancy.free.sum() > 1000
    assert occupancy.occupied.sum() > 50


def test_run_json_says_how_to_repeat_it(run_folder, log_file):
    run = json.loads((run_folder / "run.json").read_text())
    assert (run["method"], run["seed"]) == ("gmapping", 3)
    assert run["configuration"]["num_particles"] == 3
    assert run["configuration"]["lidar.usable_range"] == 3.0
    assert run["log"]["sha256"] == file_sha256(log_file)
    assert {"jaxslam", "jax", "python", "platform"} <= set(run["versions"])
    assert "--seed 3" in run["command"]


def test_written_configuration_repeats_the_run(run_folder, log_file, tmp_path):
    config = str(run_folder / "config.toml")
    assert main(["run", str(log_file), "--config", config, "--seed", "3", "--out", str(tmp_path)]) == 0
    for name in ("trajectory.tum", "map.pgm", "config.toml"):
        assert (tmp_path / name).read_bytes() == (run_folder / name).read_bytes(), name


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--particles", "0"], "--particles is 0: give 1 or more"),
        (["--particles=-2"], "--particles is -2: give 1 or more"),
        (["--seed", "-1"], "--seed is -1: give 0 to 4294967295"),
        (["--particles", "many"], "--particles is 'many': give a whole number"),
        (["--set", "sigma_hitt=1"], "did you mean 'sensor.sigma_hit'"),
        (["--set", "sigma_hit=0.1", "--set", "sigma_hit=0.2"], "given 2 times"),
        (["--set", "sigma_hit"], "sigma_hit"),
        (["--method", "gmaping"], "did you mean 'gmapping'"),
        (["--lidar", "sik"], "did you mean 'sick'"),
        (["--lidar", "Hokuyo"], "did you mean 'urg-04lx'? There are sick, urg-04lx, rplidar-a1"),
        (["--lidar", "ydlidar"], "no lidar preset is called 'ydlidar': There are sick,"),
        (["--map-margin", "nan"], "map.margin is nan: give a finite number"),
        (["--map-margin", "1e7"], "lower num_particles or"),
        (["--seed", "x"], "--seed is 'x': give a whole number"),
        (["--map-margin", "wide"], "--map-margin is 'wide': give a number"),
        (["--seed", "4294967296"], "--seed is 4294967296: give 0 to 4294967295"),
        (["--scan-topic", "/scan"], "a CARMEN log has no topics"),
        (["--relations", "missing"], "missing: no such file"),
        (["--reference", "missing"], "missing: no such file"),
        (
            ["--config", "gone.toml"],
            "gone.toml: no such file: check the path, or give a configuration in TOML",
        ),
        (
            ["--partciles", "3"],
            "run has no flag '--partciles': did you mean '--particles'? `jaxslam run --help`",
        ),
        (["--map_margni=3"], "run has no flag '--map-margni': did you mean '--map-margin'?"),
        (["--zzz"], "run has no flag '--zzz': `jaxslam run --help` lists them"),
        (["--particles"], "--particles needs a value (see --help)"),
        (["--out", ""], "--out is followed by an empty value: give a value"),
        (["--out="], "--out is followed by an empty value: give a value"),
        (
            ["--out", "/dev/null/x"],
            "/dev/null/x: cannot be created (Not a directory): give another with --out",
        ),
    ],
)
def test_bad_flags(arguments, message, log_file, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["run", str(log_file), *arguments]) == 2
    assert message in error_line(capsys)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run"], "jaxslam run needs LOG (see --help)"),
        (["localize"], "jaxslam localize needs LOG and --map MAP.yaml (see --help)"),
        (["localize", "a.log", "--glob"], "localize has no flag '--glob': did you mean '--global'?"),
        (["demo", "--particles", "-5"], "--particles is -5: give 1 or more"),
        (["study", "gone.toml"], "gone.toml: no such file: check the path, or give a study in TOML"),
        (["rnu"], "no command is called 'rnu': did you mean 'run'? There are run, demo"),
    ],
)
def test_bad_command_lines(arguments, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    assert error_line(capsys).removeprefix("jaxslam: error: ").startswith(message)
    assert list(tmp_path.iterdir()) == []


def test_files_of_the_other_flag_are_recognized(log_file, data_dir, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    relations, poses = (data_dir / "carmen" / name for name in ("intel.relations", "csail.reference.tum"))
    assert main(["run", str(log_file), "--reference", str(relations)]) == 2
    assert "intel.relations: these are relations, not poses in TUM format" in error_line(capsys)
    assert main(["run", str(log_file), "--relations", str(poses)]) == 2
    assert "csail.reference.tum: these are poses in TUM format, not relations" in error_line(capsys)
    assert list(tmp_path.iterdir()) == []


def test_a_log_without_scans_can_be_fused(data_dir, capsys):
    assert main(["run", str(data_dir / "bags/husky.bag")]) == 2
    assert error_line(capsys).endswith("or fuse its odometry and IMU with `jaxslam fuse`")


def _no_scans(lines):
    return "\n".join(f"ODOM {i} 0 0 0 0 0 {i}.0 h {i}.0" for i in range(9))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "no such file"),
        (b"", ""),
        (_no_scans(None).encode(), "no laser scans"),
        (gzip.compress(_no_scans(None).encode() * 50, mtime=0)[:60], ""),
        (b"\x00\x01\x02 nothing known", ""),
    ],
    ids=["missing", "empty", "no scans", "truncated gzip", "garbage"],
)
@pytest.mark.parametrize("command", ["run", "info"])
def test_bad_logs(command, content, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "bad.clf"
    if content is not None:
        path.write_bytes(content)
    code = main([command, str(path)])
    if command == "info" and message == "no laser scans":
        assert code == 0  # there is something to tell
        return
    assert code == 2
    line = error_line(capsys)
    assert message in line
    assert "bad.clf" in line


def test_no_odometry(capsys, tmp_path, monkeypatch, data_dir):
    monkeypatch.chdir(tmp_path)
    log = data_dir / "calibration" / "turtlebot3_wall_1.0m.mcap"
    assert main(["run", str(log)]) == 2
    captured = capsys.readouterr().err.splitlines()
    assert "no odometry" in captured[-1]
    # Its mounting is not known either, and that is said once.
    assert len([line for line in captured if "warning" in line and "mounting" in line]) == 1


def test_unknown_topic_names_the_nearest(capsys, data_dir):
    log = data_dir / "bags" / "turtlebot3_drive.mcap"
    assert main(["run", str(log), "--scan-topic", "/scam"]) == 2
    assert "did you mean '/scan'" in error_line(capsys)


def test_robot_off_the_map_names_the_flag(log_file, capsys, tmp_path):
    given = ["run", str(log_file), "--out", str(tmp_path), *SMALL[:3], "map.margin_share=0"]
    assert main([*given, "--map-margin", "0", "--method", "rbpf", "--particles", "3"]) == 2
    assert "--map-margin" in error_line(capsys)


def test_out_that_is_a_file(log_file, capsys):
    assert main(["run", str(log_file), "--out", str(log_file)]) == 2
    assert "is a file" in error_line(capsys)


def test_interrupt(monkeypatch, capsys, log_file):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("jaxslam.cli.run.execute", interrupt)
    assert main(["run", str(log_file)]) == 130
    assert capsys.readouterr().err.strip() == "jaxslam: interrupted"


@pytest.mark.parametrize(
    ("module", "command"), [("jaxslam.cli.main", "config"), ("experiments.__main__", "list")]
)
def test_output_that_nobody_reads(module, command):
    """As of `jaxslam config | head -1`."""
    reading, writing = os.pipe()
    os.close(reading)
    program = f"import sys; from {module} import main; sys.exit(main(['{command}']))"
    root = Path(__file__).parents[2]
    done = subprocess.run(
        [sys.executable, "-u", "-c", program],
        stdout=writing,
        stderr=subprocess.PIPE,
        text=True,
        cwd=root,
        check=False,
    )
    os.close(writing)
    assert (done.returncode, done.stderr) == (141, "")


@pytest.mark.parametrize("module", ["tyro", "matplotlib"])
def test_missing_extra(module, monkeypatch, capsys):
    def missing(*_):
        raise ModuleNotFoundError(f"No module named '{module}'", name=module)

    monkeypatch.setattr("jaxslam.cli.main._dispatch", missing)
    assert main(["run", "x"]) == 2
    assert error_line(capsys).endswith(f"{module} is not installed: pip install 'jaxslam[cli]'")


def test_config_prints_the_settings_of_a_localization(tmp_path, capsys):
    given = ["config", "--localization", "--lidar", "lds-01", "--particles", "5000", "--set", "sigma_hit=0.3"]
    assert main(given) == 0
    text = capsys.readouterr().out
    values = tomllib.loads(text)
    assert values["max_particles"] == 5000
    assert values["sensor"]["sigma_hit"] == 0.3
    assert values["lidar"]["usable_range"] == 3.5
    assert "proposal" not in values
    # It is one to give.
    path = tmp_path / "mine.toml"
    path.write_text(text)
    assert main(["config", "--localization", "--config", str(path)]) == 0
    assert capsys.readouterr().out == text
    assert main(["config", "--localization", "--method", "rbpf"]) == 2
    assert "--method applies to `run` only" in capsys.readouterr().err


@pytest.mark.parametrize("settings", [["sigma_hit=0.3", "margin=4"], ["sigma_hit=0.3", "--set", "margin=4"]])
def test_config_prints_what_it_was_told(settings, capsys):
    assert main(["config", "--lidar", "lds-01", "--method", "rbpf", "--set", *settings]) == 0
    printed = capsys.readouterr().out
    for line in ('name = "lds-01"', 'kind = "motion"', "sigma_hit = 0.3", "margin = 4.0"):
        assert line in printed


def test_info(log_file, capsys):
    assert main(["info", str(log_file)]) == 0
    printed = capsys.readouterr().out
    assert "60 scans" in printed
    assert "lidar preset" in printed


def test_version(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("jaxslam ")


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_is_in_the_help_and_has_a_help_of_its_own(command, capsys):
    assert main(["--help"]) == 0
    assert f"\n  {command} " in capsys.readouterr().out
    assert main([command, "--help"]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith(f"usage: jaxslam {command} ")
    assert COMMANDS[command].split()[0] in printed


def test_default_folder():
    assert default_folder(Path("d/intel.clf.gz"), "gmapping", 0) == Path("runs/intel-gmapping-s0")
    assert default_folder(Path("d/a.b.mcap"), "rbpf", 7) == Path("runs/a.b-rbpf-s7")
    assert default_folder(Path("d/husky.bag"), "fuse") == Path("runs/husky-fuse")


def test_strict_json(tmp_path):
    write_json(tmp_path / "a.json", {"a": math.nan, "b": [1.5, -math.inf], "c": {"d": None}})
    assert json.loads((tmp_path / "a.json").read_text()) == {"a": None, "b": [1.5, None], "c": {"d": None}}
