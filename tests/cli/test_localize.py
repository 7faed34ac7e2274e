"""`jaxslam localize`: a simulated drive against its reference, Wean Hall, and input that cannot be used."""

import json

import jax
import numpy as np
import pytest

from jaxslam.cli.main import main
from jaxslam.grid.known_map import KnownMap
from jaxslam.io import read_tum, write_map, write_tum
from jaxslam.sim import sick, simulate
from jaxslam.viz.clouds import in_map_axes
from tests.builders import carmen_log, hall_map, room

SMALL = ["--particles", "4096"]


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """A map, a CARMEN log of half a minute in it, and where the robot truly was."""
    folder = tmp_path_factory.mktemp("drive")
    occupancy, world, waypoints = hall_map()
    write_map(folder / "hall.yaml", occupancy.probability, 0.05, (-0.5, -0.5, 0.0))
    simulation = simulate(jax.random.key(3), world, waypoints, lidar=sick(num_beams=181), duration=30.0)
    odometry, times = np.asarray(simulation.odometry.poses, float), simulation.odometry_times
    poses = np.stack([np.interp(simulation.scan_times, times, column) for column in odometry.T], axis=1)
    readings = np.where(simulation.scans.valid, simulation.scans.ranges, np.inf)
    (folder / "drive.log").write_text(carmen_log(simulation.scan_times, readings, poses))
    write_tum(folder / "truth.tum", simulation.scan_times, np.asarray(simulation.scan_poses, float))
    return folder, np.asarray(simulation.scan_poses, float)


def run(drive, out, *flags, log=None, map=None):
    folder, _ = drive
    log, map = log or folder / "drive.log", map or folder / "hall.yaml"
    return main(["localize", str(log), "--map", str(map), *SMALL, "--out", str(out), *flags])


def test_a_start_that_is_known(drive, tmp_path, capsys):
    folder, truth = drive
    start = ",".join(str(value) for value in truth[0])
    assert run(drive, tmp_path, "--start", start, "--reference", str(folder / "truth.tum"), "--gif") == 0
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert metrics["converged"] is True
    assert metrics["ate"]["rmse_m"] < 0.1
    assert metrics["kidnapped_events"] == 0
    assert metrics["match_score"] > 0.9
    assert metrics["ms_per_scan"] > 0
    assert metrics["beam_evaluations_per_s"] > 1e5
    assert metrics["particles_max"] == 4096
    stamps, poses = read_tum(tmp_path / "trajectory.tum")
    assert len(stamps) == len(truth)
    assert np.hypot(*(poses[-1] - truth[-1])[:2]) < 0.2
    for picture in ("cloud.png", "particles.png", "cloud.gif"):
        assert (tmp_path / picture).stat().st_size > 5_000
    run_json = json.loads((tmp_path / "run.json").read_text())
    assert run_json["map"]["path"].endswith("hall.yaml")
    printed = capsys.readouterr().out
    assert "converged yes" in printed
    assert "m RMSE" in printed


def test_the_written_configuration_is_one_to_give(drive, tmp_path):
    _, truth = drive
    start = ",".join(str(value) for value in truth[0])
    flags = ["--start", start, "--set", "sensor.sigma_hit=0.15", "recovery.slow=0"]
    assert run(drive, tmp_path / "one", *flags) == 0
    written = tmp_path / "one" / "config.toml"
    assert "sigma_hit = 0.15" in written.read_text()
    assert run(drive, tmp_path / "two", "--start", start, "--config", str(written)) == 0
    one, two = ((tmp_path / name / "trajectory.tum").read_bytes() for name in ("one", "two"))
    assert one == two


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        ([], "give either --start X,Y,THETA (meters, meters, radians) or --global"),
        (["--global", "--start", "1,1,0"], "give either"),
        (["--start", "1,1"], "give X,Y,THETA"),
        (["--start", "1,one,0"], "give X,Y,THETA"),
        (["--start", "nan,1,0"], "give X,Y,THETA"),
        (["--start", "100,1,0"], "is not on the map, which is 19 × 16 m"),
        (["--global", "--set", "recovery.slow=0.5"], "give slow < fast"),
        (["--global", "--set", "bins.translation=0"], "translation is 0.0"),
        (["--global", "--set", "bins.translation=0.001"], "raise bins.translation"),
        (["--global", "--particles", "0"], "give 1 or more"),
        (["--global", "--set", "max_particles=99999999999999999999"], "lower max_particles"),
        (["--global", "--set", "bins.translation=1e-320"], "too large or too small"),
        (["--start", "5,5,0", "--set", "start.deviation=1e30"], "or search the whole map with --global"),
        (["--global", "--set", "sensor.beam.kind=beam"], "no setting is called"),
    ],
)
def test_wrong_flags_are_told(drive, tmp_path, capsys, flags, message):
    assert run(drive, tmp_path / "new", *flags) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: f.joinpath("hall.yaml").unlink(), "no such file"),
        (lambda f: f.joinpath("hall.pgm").unlink(), "hall.pgm"),
        (lambda f: f.joinpath("hall.pgm").write_bytes(f.joinpath("hall.pgm").read_bytes()[:500]), "hall.pgm"),
        (lambda f: _edit(f, "resolution: 0.05", "resolution: -0.05"), "resolution is -0.05"),
        (lambda f: _edit(f, "resolution: 0.05", "resolution: 1e-30"), "expected 0.0001 to 1000"),
        (lambda f: _edit(f, "resolution: 0.05", f"resolution: {10**400}"), "expected a number"),
        (lambda f: _edit(f, "origin: [-0.5", "origin: [1e39"), "expected x and y up to 1e+08 m"),
        (lambda f: _edit(f, "negate: 0", "negate: 1"), None),
    ],
    ids=[
        "no map",
        "no image",
        "truncated image",
        "negative resolution",
        "tiny resolution",
        "endless resolution",
        "far origin",
        "negated",
    ],
)
def test_maps_that_cannot_be_used_are_told(drive, tmp_path, capsys, change, message):
    folder = tmp_path / "map"
    folder.mkdir()
    for name in ("hall.yaml", "hall.pgm"):
        folder.joinpath(name).write_bytes((drive[0] / name).read_bytes())
    change(folder)
    code = run(drive, tmp_path / "out", "--global", map=folder / "hall.yaml")
    if message is None:
        # Walls free and the rest occupied: a map in which nothing fits, but one.
        assert code == 0
        metrics = json.loads((tmp_path / "out" / "metrics.json").read_text())
        assert metrics["converged"] is False
        assert "do not agree" in capsys.readouterr().err
    else:
        assert code == 2
        assert message in capsys.readouterr().err


def _edit(folder, old, new):
    path = folder / "hall.yaml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def _shifted(path, source, rows, seconds):
    stamps, poses = read_tum(source)
    write_tum(path, stamps[rows] + seconds, poses[rows])
    return path


def test_a_reference_that_does_not_belong_is_found_before_the_run(drive, tmp_path, capsys):
    folder, _ = drive
    late = _shifted(tmp_path / "late.tum", folder / "truth.tum", slice(None), 1e4)
    assert run(drive, tmp_path / "new", "--global", "--reference", str(late)) == 2
    assert "late.tum: 0 of its 300 poses" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_a_reference_that_ends_before_the_particles_agree_costs_no_run(drive, tmp_path, capsys):
    folder, _ = drive
    early = _shifted(tmp_path / "early.tum", folder / "truth.tum", slice(0, 3), 0.0)
    assert run(drive, tmp_path / "new", "--global", "--reference", str(early)) == 0
    assert "early.tum: no error is reported" in capsys.readouterr().err
    metrics = json.loads((tmp_path / "new" / "metrics.json").read_text())
    assert "ate" not in metrics
    assert (tmp_path / "new" / "trajectory.tum").stat().st_size > 0


def test_a_map_far_from_its_origin_is_warned_of(drive, tmp_path, capsys):
    for name in ("hall.yaml", "hall.pgm"):
        (tmp_path / name).write_bytes((drive[0] / name).read_bytes())
    _edit(tmp_path, "origin: [-0.5", "origin: [4500000")
    assert run(drive, tmp_path / "out", "--global", map=tmp_path / "hall.yaml") == 0
    assert "positions are resolved to only 0.5 m" in capsys.readouterr().err


def test_a_map_without_free_space_is_told(drive, tmp_path, capsys):
    write_map(tmp_path / "full.yaml", np.ones((40, 40)), 0.05)
    assert run(drive, tmp_path / "out", "--global", map=tmp_path / "full.yaml") == 2
    assert "full.yaml: no free cell among its 40 × 40 cells" in capsys.readouterr().err


def test_a_log_that_sees_nothing_runs_and_says_so(drive, tmp_path, capsys):
    blind = "\n".join(f"FLASER 3 81.83 81.83 81.83 {i / 2} 0 0 {i / 2} 0 0 {i} sim {i}" for i in range(6))
    (tmp_path / "blind.log").write_text(blind + "\n")
    assert run(drive, tmp_path / "out", "--start", "1.4,1.4,0", log=tmp_path / "blind.log") == 0
    assert "6 of 6 scans had too few returns" in capsys.readouterr().err
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text())
    assert metrics["match_score"] is None


def test_a_turned_map_gives_the_turned_trajectory(drive, tmp_path):
    """The same image under another origin: the same run, elsewhere."""
    folder, truth = drive
    (tmp_path / "hall.pgm").write_bytes((folder / "hall.pgm").read_bytes())
    text = (folder / "hall.yaml").read_text()
    (tmp_path / "hall.yaml").write_text(text.replace("origin: [-0.5, -0.5, 0.0]", "origin: [2.0, 3.0, 0.6]"))
    local = truth[0] + np.array([0.5, 0.5, 0.0])
    cos, sin = np.cos(0.6), np.sin(0.6)
    x, y = 2.0 + cos * local[0] - sin * local[1], 3.0 + sin * local[0] + cos * local[1]
    start = f"{x},{y},{local[2] + 0.6}"
    assert run(drive, tmp_path / "out", "--start", start, map=tmp_path / "hall.yaml") == 0
    _, poses = read_tum(tmp_path / "out" / "trajectory.tum")
    end = truth[-1] + np.array([0.5, 0.5, 0.0])
    expected = [2.0 + cos * end[0] - sin * end[1], 3.0 + sin * end[0] + cos * end[1]]
    assert np.hypot(*(poses[-1, :2] - expected)) < 0.2


def test_drawings_of_a_turned_map_are_upright():
    occupancy = room(origin=(1.0, -2.0, np.pi / 2))
    drawn = in_map_axes(KnownMap.from_map(occupancy), np.array([[1.0, -1.0, np.pi / 2]]))
    np.testing.assert_allclose(drawn, [[2.0, -2.0, 0.0]], atol=1e-6)


def test_wean_hall_from_anywhere(data_dir, tmp_path):
    log, map_ = str(data_dir / "carmen/wean_robotdata1.clf.gz"), str(data_dir / "maps/wean.yaml")
    assert main(["localize", log, "--map", map_, "--global", "--out", str(tmp_path)]) == 0
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert metrics["converged"] is True
    assert metrics["match_score"] > 0.85
    assert metrics["particles_max"] == 100_000
    assert metrics["particles_median"] < 2000
    _, poses = read_tum(tmp_path / "trajectory.tum")
    # Where ten seeds out of ten end.
    assert np.hypot(*(poses[-1, :2] - [39.9, 41.4])) < 0.5
