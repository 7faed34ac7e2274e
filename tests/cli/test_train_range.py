"""`jaxslam train-range`, and what a run does with the network: a simulated lidar that is off, real bags."""

import contextlib
import io
import pickle

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.cli.main import main
from jaxslam.core.trajectory import interpolate_poses
from jaxslam.io import read_map, write_map, write_tum
from jaxslam.range_network import RangeNetwork, load_network, save_network
from jaxslam.report import file_sha256
from jaxslam.sim import (
    calibration_distances,
    calibration_run,
    draw_lds_01_bias,
    hall_small,
    lds_01,
    simulate,
    to_log,
)
from tests.builders import carmen_log, forward_half, hall_map
from tests.checks import error_line, strict_json

# As far off as its data sheet allows somewhere: 12 cm at 2.5 m.
BIAS = draw_lds_01_bias(jax.random.key(0), share=1.0)
QUICK = ["--neurons", "20", "--restarts", "2"]
FIGURES = ("readings.png", "errors.png", "histograms.png", "deviations.png", "training.png")


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """The folder of a network learnt from 35 distances, and what was printed while it was."""
    folder = tmp_path_factory.mktemp("trained")
    lidar = lds_01(BIAS)
    distances = calibration_distances(lidar)
    ranges, _ = calibration_run(jax.random.key(9), lidar, distances, 100)
    lines = [
        f"{distance:.2f},{reading:.3f}"
        for distance, readings in zip(np.asarray(distances), np.asarray(ranges), strict=True)
        for reading in readings
    ]
    (folder / "wall.csv").write_text("true_m,measured_m\n" + "\n".join(lines) + "\n")
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(["train-range", str(folder / "wall.csv"), "--out", str(folder / "lds.eqx"), *QUICK])
    assert code == 0, err.getvalue()
    return folder, out.getvalue(), err.getvalue(), int(np.count_nonzero(np.asarray(ranges) == 0))


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """12 s of a drive with that lidar, as CARMEN messages of its forward half circle, and the truth."""
    folder = tmp_path_factory.mktemp("drive")
    world, waypoints = hall_small()
    simulation = simulate(jax.random.key(0), world, waypoints, lidar=lds_01(BIAS), duration=12.0)
    log = to_log(simulation, start_stamp=100.0, in_world_frame=True)
    assert log.scans is not None
    assert log.odometry is not None
    poses = interpolate_poses(log.odometry.stamps, log.odometry.poses, log.scans.stamps)
    half = forward_half(log.scans.ranges)
    (folder / "hall.log").write_text(carmen_log(log.scans.stamps, half, poses, mounting=-0.032))
    write_tum(folder / "truth.tum", log.scans.stamps, np.asarray(simulation.scan_poses, float))
    write_map(folder / "hall.yaml", hall_map()[0].probability, 0.05, (-0.5, -0.5, 0.0))
    start = ",".join(f"{value:.3f}" for value in np.asarray(simulation.scan_poses)[0])
    return folder, np.asarray(world.segments, float), start


def table_of(path, distances, offset=0.02):
    """A few readings at each distance, all off by the same."""
    rows = [f"{d},{d + offset + 0.001 * i}" for d in distances for i in (-1, 0, 1)]
    path.write_text("true_m,measured_m\n" + "\n".join(rows) + "\n")
    return str(path)


def test_what_is_written(trained):
    folder, _, _, num_lost = trained
    written = folder / "lds-training"
    assert {path.name for path in written.iterdir()} == {*FIGURES, "training.json"}
    for name in FIGURES:
        assert (written / name).stat().st_size > 10_000, name
    training = strict_json(written / "training.json")
    assert training["lost"] == num_lost > 0
    assert training["readings"] == 3500 - num_lost
    assert training["network"]["sha256"] == file_sha256(folder / "lds.eqx")
    assert training["command"].startswith("jaxslam train-range ")
    assert (training["seed"], training["method"]) == (0, "levenberg-marquardt")
    assert [attempt["num_neurons"] for attempt in training["attempts"]] == [20]
    assert {"jaxslam", "jax", "python"} <= set(training["versions"])


def test_errors_by_distance_and_by_role(trained):
    training = strict_json(trained[0] / "lds-training" / "training.json")
    rows = training["distances"]
    assert [row["distance"] for row in rows] == sorted(row["distance"] for row in rows)
    assert sum(row["count"] for row in rows) == training["readings"]
    roles = {row["role"]: row for row in training["roles"]}
    assert set(roles) == {"training", "validation", "held out"}
    # At distances of which nothing was learnt: 51 mm raw, and 19 mm of noise.
    assert roles["held out"]["corrected_rmse"] < 1.25 * roles["held out"]["noise"]
    assert roles["held out"]["raw_rmse"] > 2 * roles["held out"]["corrected_rmse"]
    for row in rows:
        if 0.3 < row["distance"] < 3.0:
            # Four standard errors of 100 readings.
            expected = float(BIAS(jnp.asarray(row["distance"])))
            assert row["raw_mean"] == pytest.approx(expected, abs=4 * row["raw_std"] / 10)
    chosen = [row for row in rows if row["role"] == "held out"]
    counts = np.array([row["count"] for row in chosen])
    squares = np.array([row["raw_mean"] ** 2 + row["raw_std"] ** 2 for row in chosen])
    expected = np.sqrt((counts * squares).sum() / counts.sum())
    assert roles["held out"]["raw_rmse"] == pytest.approx(expected, rel=1e-9)


def test_the_table_is_printed(trained):
    folder, printed, _, num_lost = trained
    lines = printed.splitlines()
    num_distances = len(strict_json(folder / "lds-training" / "training.json")["distances"])
    assert lines[0] == f"readings  {3500 - num_lost} at {num_distances} distances"
    row = next(line for line in lines if line.split()[:1] == ["2.420"])
    assert row.split()[1] == "100"
    assert float(row.split()[2]) == pytest.approx(1e3 * float(BIAS(jnp.asarray(2.42))), abs=10.0)
    assert sum(line.endswith("  held out") for line in lines) == 7
    below = lines[next(index for index, line in enumerate(lines) if "RMSE, mm" in line) + 1 :]
    assert [line[:20].strip() for line in below[:3]] == ["training", "held out", "validation"]
    raw, corrected, noise = (float(number) for number in below[1][20:].split())
    assert corrected < 1.25 * noise < 0.6 * raw
    assert "MSE at training distances: 0.000" in printed
    assert "No distance was held out" not in printed
    assert lines[-1].startswith(f"written   {folder / 'lds.eqx'}, {folder / 'lds-training'} (errors.png")


def test_lost_readings_are_warned_of(trained):
    _, _, errors, num_lost = trained
    assert errors == f"jaxslam: warning: {num_lost} readings without a return are left out\n"


def test_the_network_corrects_that_lidar(trained):
    network = load_network(trained[0] / "lds.eqx")
    assert network.num_neurons == 20
    true = np.linspace(0.2, 3.0, 100)
    read = true + np.asarray(BIAS(jnp.asarray(true, jnp.float32)))
    off = np.asarray(network(jnp.asarray(read, jnp.float32))) - true
    # What a reading tells of the distance is less than the error alone, where that is steep and noise large.
    assert np.sqrt(np.mean((read - true) ** 2)) > 0.04
    assert np.sqrt(np.mean(off**2)) < 0.015


def test_few_distances_are_warned_of_and_several_tables_joined(tmp_path, capsys):
    one, two, more = (table_of(tmp_path / f"{d[0]}.csv", d) for d in ([1], [2], [3, 4, 5]))
    given = ["train-range", *QUICK, "--out", str(tmp_path / "a.eqx")]
    assert main([*given, one, two, more, "--held-out", "2"]) == 0
    printed = capsys.readouterr()
    assert printed.err == (
        "jaxslam: warning: too few distances for a validation set: only the mean reading of each "
        "distance is learned\n"
    )
    training = strict_json(tmp_path / "a-training" / "training.json")
    assert [(row["distance"], row["count"], row["role"]) for row in training["distances"]] == [
        (1.0, 3, "training"),
        (2.0, 3, "held out"),
        (3.0, 3, "training"),
        (4.0, 3, "training"),
        (5.0, 3, "training"),
    ]
    corrected = {row["distance"]: row["corrected_mean"] for row in training["distances"]}
    assert max(abs(corrected[distance]) for distance in (1.0, 3.0, 4.0, 5.0)) < 0.001
    # Off by 20 mm all over: the one in between as well.
    assert abs(corrected[2.0]) < 0.02
    assert "No distance was held out" not in printed.out
    # Without naming one, nothing is.
    assert main([*given, one, more]) == 0
    assert "No distance was held out: see --held-out." in capsys.readouterr().out


def test_same_seed_same_bytes(tmp_path):
    source = table_of(tmp_path / "wall.csv", [1, 2, 3, 4])
    for name, seed in (("one", "0"), ("two", "0"), ("other", "1")):
        out = str(tmp_path / f"{name}.eqx")
        assert main(["train-range", source, "--seed", seed, *QUICK, "--out", out]) == 0
    one, two, other = ((tmp_path / f"{name}.eqx").read_bytes() for name in ("one", "two", "other"))
    assert one == two != other


def test_the_name_need_not_have_a_folder_yet(tmp_path):
    source = table_of(tmp_path / "wall.csv", [1, 2, 3, 4])
    assert main(["train-range", source, *QUICK, "--out", str(tmp_path / "new" / "lds.v2.eqx")]) == 0
    assert {path.name for path in (tmp_path / "new").iterdir()} == {"lds.v2.eqx", "lds.v2-training"}


def test_a_turtlebot_before_walls(data_dir, tmp_path, capsys):
    bags = data_dir / "calibration"
    sources = [f"{bags}/turtlebot3_wall_{meters}m.mcap:{meters}" for meters in ("0.5", "1.0", "1.5", "2.0")]
    assert main(["train-range", *sources, *QUICK, "--out", str(tmp_path / "real.eqx")]) == 0
    training = strict_json(tmp_path / "real-training" / "training.json")
    raw = [row["raw_mean"] for row in training["distances"]]
    np.testing.assert_allclose(raw, [0.003, 0.0038, 0.0042, 0.0084], atol=0.0005)
    np.testing.assert_allclose([row["corrected_mean"] for row in training["distances"]], 0.0, atol=0.001)
    assert f"{training['lost']} readings without a return are left out" in capsys.readouterr().err
    network = load_network(tmp_path / "real.eqx")
    ranges = jnp.linspace(0.5, 2.0, 200)
    assert np.abs(network(ranges) - ranges).max() < 3 * max(raw)


@pytest.mark.parametrize(
    ("data", "flags", "message"),
    [
        ([], [], "give training readings: FILE.csv, or LOG:METERS of a wall"),
        (["one.csv"], [], "all readings are at one distance (1 m): give readings at two or more"),
        (["good.csv"], ["--held-out", "1.5"], "no readings at the held-out distance 1.5 m: the nearest"),
        (["good.csv"], ["--held-out", "1", "3"], "one distance (2 m) is left to learn from"),
        (["good.csv"], ["--neurons", "0"], "num_neurons is 0: give 1 or more"),
        (["good.csv"], ["--neurons", "many"], "--neurons"),
        (["good.csv"], ["--restarts", "0"], "0 restarts: give one or more of each"),
        (["good.csv"], ["--method", "sgd"], "--method"),
        (["good.csv"], ["--seed", "-1"], "--seed is -1: give 0 to 4294967295"),
        (["good.csv", "missing.csv"], [], "missing.csv: No such file"),
        (["missing.mcap:1.0"], [], "missing.mcap: no such file"),
        (["good.csv", "wall.mcap"], [], "wall.mcap: give a table as FILE.csv, or a log with the distance"),
        (["wall.mcap:0"], [], "distance of the wall is 0 m: give more than 0 and less than 500"),
        (["good.csv:1.0"], [], "good.csv"),
        (["text.csv"], [], "text.csv: line 3: measured_m is 'far', which is not a number"),
        (["other.csv"], [], "other.csv: no column measured_m in its first line (true_m, range)"),
        (["lost.csv"], [], "lost.csv: none of its 2 readings is a distance"),
        (["stuck.csv"], [], "at every distance: check that its beam faces the wall"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_what_cannot_be_learnt_is_one_line(tmp_path, capsys, monkeypatch, data, flags, message):
    monkeypatch.chdir(tmp_path)
    table_of(tmp_path / "one.csv", [1])
    table_of(tmp_path / "good.csv", [1, 2, 3])
    (tmp_path / "text.csv").write_text("true_m,measured_m\n1,1\n2,far\n")
    (tmp_path / "other.csv").write_text("true_m,range\n1,1\n")
    (tmp_path / "lost.csv").write_text("true_m,measured_m\n1,0\n2,nan\n")
    (tmp_path / "stuck.csv").write_text("true_m,measured_m\n1,1.5\n2,1.5\n")
    assert main(["train-range", *data, *flags, "--out", "net.eqx"]) == 2
    assert message in error_line(capsys)
    assert not (tmp_path / "net.eqx").exists()


@pytest.mark.parametrize("blocked", ["net.eqx", "net-training"])
def test_a_name_that_cannot_be_written_costs_no_training(tmp_path, capsys, blocked):
    source = table_of(tmp_path / "wall.csv", [1, 2, 3, 4])
    if blocked == "net.eqx":
        (tmp_path / blocked).mkdir()
    else:
        (tmp_path / blocked).write_text("a file")
    assert main(["train-range", source, *QUICK, "--out", str(tmp_path / "net.eqx")]) == 2
    captured = capsys.readouterr()
    assert str(tmp_path / blocked) in captured.err.splitlines()[-1]
    assert "neurons" not in captured.out


COMMANDS = {
    "run": lambda drive: ["run", f"{drive}/hall.log", "--particles", "2"],
    "demo": lambda drive: ["demo", "--duration", "5", "--particles", "2"],
    "localize": lambda drive: ["localize", f"{drive}/hall.log", "--map", f"{drive}/hall.yaml", "--global"],
}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"true_m,measured_m\n1,1\n", "net.eqx: not a range network; `jaxslam train-range` writes one"),
        (b"", "net.eqx: not a range network"),
        (pickle.dumps([1.0]), "net.eqx: not a range network"),
        (None, "net.eqx: No such file"),
    ],
    ids=["table", "empty", "pickle", "missing"],
)
@pytest.mark.parametrize("command", COMMANDS)
def test_a_file_that_is_no_network_makes_no_run(drive, tmp_path, capsys, command, content, message):
    if content is not None:
        (tmp_path / "net.eqx").write_bytes(content)
    given = [*COMMANDS[command](drive[0]), "--range-network", str(tmp_path / "net.eqx")]
    assert main([*given, "--out", str(tmp_path / "new")]) == 2
    assert message in error_line(capsys)
    assert not (tmp_path / "new").exists()


def distances_to(segments, points):
    start, along = segments[:, :2], segments[:, 2:] - segments[:, :2]
    share = ((points[:, None] - start) * along).sum(-1) / (along**2).sum(-1)
    nearest = start + np.clip(share, 0.0, 1.0)[..., None] * along
    return np.linalg.norm(points[:, None] - nearest, axis=-1).min(axis=1)


def wall_error(folder, segments):
    """Root mean square of what the occupied cells of a map are off the true walls, meters."""
    found = read_map(folder / "map.yaml")
    cells = (np.argwhere(found.occupied)[:, ::-1] + 0.5) * found.resolution + found.origin[:2]
    assert len(cells) > 300
    return np.sqrt(np.mean(distances_to(segments, cells) ** 2))


def test_a_map_is_better_with_the_network(trained, drive, tmp_path):
    folder, segments, _ = drive
    network = trained[0] / "lds.eqx"
    settings = ["--particles", "5", "--set", "usable_range=3.4", "map.margin=2"]
    given = ["run", str(folder / "hall.log"), "--reference", str(folder / "truth.tum"), *settings]
    with_it, without = tmp_path / "with", tmp_path / "without"
    assert main([*given, "--out", str(without)]) == 0
    assert main([*given, "--range-network", str(network), "--out", str(with_it)]) == 0
    # Headings came out at 0.2° and 1.6° off, the map at 23 and 76 mm.
    headings = [metrics_of(path)["ate"]["rot_rmse_deg"] for path in (with_it, without)]
    assert headings[0] < 0.5 * headings[1]
    assert wall_error(with_it, segments) < 0.5 * wall_error(without, segments)
    named = [strict_json(path / "run.json")["range_network"] for path in (with_it, without)]
    assert named == [{"path": str(network.resolve()), "sha256": file_sha256(network)}, None]


def metrics_of(folder):
    return strict_json(folder / "metrics.json")


def wrong_network(path):
    """One that adds 0.7 m to everything."""
    network = RangeNetwork.draw(jax.random.key(0), 20, 0.12, 3.5)
    save_network(path, eqx.tree_at(lambda n: n.bias_out, network, jnp.asarray(0.7 / 1.69, jnp.float32)))
    return path


def test_a_localization_uses_the_network(trained, drive, tmp_path):
    folder, _, start = drive
    given = ["localize", str(folder / "hall.log"), "--map", str(folder / "hall.yaml"), "--start", start]
    given += ["--particles", "1024", "--reference", str(folder / "truth.tum")]
    right, wrong = trained[0] / "lds.eqx", wrong_network(tmp_path / "wrong.eqx")
    errors = []
    for network in (right, wrong):
        out = tmp_path / f"out-{network.stem}"
        assert main([*given, "--range-network", str(network), "--out", str(out)]) == 0
        assert strict_json(out / "run.json")["range_network"]["sha256"] == file_sha256(network)
        errors.append(metrics_of(out)["ate"]["rmse_m"])
    assert errors[0] < 0.1 < 0.2 < errors[1]


def test_a_demo_uses_the_network(tmp_path):
    wrong = wrong_network(tmp_path / "wrong.eqx")
    given = ["demo", "--duration", "6", "--particles", "2", "--method", "rbpf", "--set", "window=8"]
    assert main([*given, "--range-network", str(wrong), "--out", str(tmp_path / "out")]) == 0
    # Without it half of the cells lie where a wall is.
    assert metrics_of(tmp_path / "out")["map"]["precision"] < 0.25
    assert strict_json(tmp_path / "out" / "run.json")["range_network"]["sha256"] == file_sha256(wrong)
