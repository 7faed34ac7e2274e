"""`jaxslam study` and `jaxslam study report`, end to end: killed, interrupted, gone on with, reported on."""

import json
import os
import re
import signal
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest

from jaxslam.cli.main import main
from jaxslam.config.dotted import flatten
from jaxslam.config.lidar_presets import PRESETS
from jaxslam.config.resolve import resolve_config
from jaxslam.config.slam import SlamConfig
from tests.checks import error_line

MORE = 3
"""Trials of the last session, after one that is killed and one that is interrupted."""
SPACE = """
"sensor.sigma_hit" = { low = 0.02, high = 0.3, log = true }
"motion.rotation_floor" = { low = 0.01, high = 0.1 }
"""
PLAN = f"""
[study]
name = "hall"
method = "rbpf"
seeds = 2
held_out_seeds = [7]
trials = 500
[filter]
num_particles = 3
map.margin = 4.0
map.window = 8.0
lidar.usable_range = 6.0
[[logs]]
world = "hall_small"
duration = 10
[[held_out]]
world = "hall_small"
duration = 10
seed = 7
[space]
{SPACE}"""


def start(folder, *flags):
    """`jaxslam study` as a process of its own: no other way to kill it."""
    # As in a terminal: a shell starts what runs in the background deaf to Ctrl-C, perhaps these tests too.
    hear = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    command = [
        sys.executable,
        "-c",
        f"{hear}; import sys; from jaxslam.cli.main import main; sys.exit(main())",
    ]
    command += ["study", "plan.toml", "--storage", "hall.db", "--out", "out", *flags]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen(command, cwd=folder, text=True, encoding="utf-8", **pipes)


def end_after(process, num_trials, how):
    """Ends it when so many trials were told, somewhere in the next one."""
    for line in process.stdout:
        if line.startswith("trial "):
            num_trials -= 1
        if num_trials == 0:
            break
    os.kill(process.pid, how)
    _, errors = process.communicate(timeout=120)
    return process.returncode, errors


def rows_of(path):
    """The rows of a study's storage, as anybody may read them: number and state."""
    database = sqlite3.connect(path)
    rows = database.execute("SELECT number, state FROM trials ORDER BY number").fetchall()
    database.close()
    return rows


@pytest.fixture(scope="module")
def ended(tmp_path_factory):
    """The folder of a study that was killed, interrupted and gone on with; and what it printed last."""
    folder = tmp_path_factory.mktemp("study")
    (folder / "plan.toml").write_text(PLAN, encoding="utf-8")
    killed = end_after(start(folder), 2, signal.SIGKILL)
    rows = [rows_of(folder / "hall.db")]
    interrupted = end_after(start(folder), 1, signal.SIGINT)
    rows.append(rows_of(folder / "hall.db"))
    total = [state for _, state in rows[1]].count("COMPLETE") + MORE
    output, errors = start(folder, "--trials", str(total)).communicate(timeout=300)
    rows.append(rows_of(folder / "hall.db"))
    assert errors == ""
    return folder, output, killed, interrupted, rows


def test_a_study_that_is_killed_loses_the_trial_in_flight_at_most(ended):
    _, _, (code, errors), _, rows = ended
    assert (code, errors) == (-signal.SIGKILL, "")
    states = [state for _, state in rows[0]]
    assert states.count("COMPLETE") >= 2
    assert set(states[:-1]) == {"COMPLETE"}
    assert states[-1] in ("COMPLETE", "RUNNING")


def test_a_study_that_is_interrupted_says_so_in_one_line(ended):
    _, _, _, (code, errors), rows = ended
    assert code == 130
    assert errors.strip() == "jaxslam: interrupted"
    states = [state for _, state in rows[1]]
    # The interrupted trial is lost, and known to be.
    assert states.count("COMPLETE") >= 3
    assert states[-1] in ("FAIL", "COMPLETE")


def test_a_study_goes_on_to_all_its_trials(ended):
    _, output, _, _, rows = ended
    before = [state for _, state in rows[1]].count("COMPLETE")
    states, total = [state for _, state in rows[2]], before + MORE
    assert states.count("COMPLETE") == total
    # One by the kill, one by the interruption.
    assert len(states) <= total + 2
    assert states[-MORE:] == ["COMPLETE"] * MORE
    assert f"study     hall: {total} trials by tpe, {before} of them in " in output
    assert "logs      hall_small-0; seeds 0–1" in output
    assert "space     sensor.sigma_hit: 0.02 to 0.3 on a logarithmic scale" in output
    told = re.findall(r"^trial (\d+) +(\S+)   sensor.sigma_hit=\S+ motion.rotation_floor=\S+", output, re.M)
    assert len(told) == MORE
    assert f"{total} trials with values, 0 failed, {len(states) - total} lost or in flight." in output


def cells_of(line):
    return [cell.strip() for cell in line.strip("| ").split("|")]


def test_held_out_logs_and_seeds_stand_beside_the_tuned_ones(ended):
    folder, output, _, _, _ = ended
    text = (folder / "out" / "held-out.md").read_text()
    assert text in output
    header, _, *lines = text.splitlines()
    assert "error, m: before" in header
    assert "error, m: tuned" in header
    rows = {cells_of(line)[0]: [float(cell) for cell in cells_of(line)[1:]] for line in lines}
    assert list(rows) == ["tuned on, its seeds", "tuned on, other seeds", "held out: hall_small-7"]
    trials = json.loads((folder / "out" / "trials.json").read_text())
    best = min(trial["values"][0] for trial in trials if trial["values"] is not None)
    # What was tuned comes out again as the trial had it, and is better than what it began from.
    assert rows["tuned on, its seeds"][1] == pytest.approx(best, rel=1e-3)
    assert rows["tuned on, its seeds"][1] < rows["tuned on, its seeds"][0]
    assert len({value for row in rows.values() for value in row}) == 6


def test_the_programs_are_kept(ended):
    """Else every process would have compiled its own."""
    assert any("jit" in path.name for path in (ended[0] / "out" / "programs").iterdir())


def test_the_report_of_a_study(ended, capsys):
    folder = ended[0]
    assert main(["study", "report", str(folder / "hall.db"), "--out", str(folder / "report")]) == 0
    output = capsys.readouterr().out
    written = {path.name for path in (folder / "report").iterdir()}
    pictures = {"history.png", "parallel.png", "importance.png"}
    assert written == {"report.md", "trials.json", "best.toml"} | pictures
    for part in (" trials with values, 0 failed", "| trial | error, m |", "| importance for |"):
        assert part in output
    # As the study itself has reported.
    for name in ("report.md", "best.toml", "trials.json"):
        assert (folder / "report" / name).read_bytes() == (folder / "out" / name).read_bytes()


def test_the_best_configuration_is_one_that_run_takes(ended):
    folder = ended[0]
    trials = json.loads((folder / "out" / "trials.json").read_text())
    best = min((trial for trial in trials if trial["values"]), key=lambda trial: trial["values"])

    configuration = resolve_config(SlamConfig(), config=folder / "out" / "best.toml")
    found = flatten(configuration)
    tuned = {**best["settings"], "num_particles": 3, "map.margin": 4.0, "map.window": 8.0}
    assert {name: found[name] for name in tuned} == tuned
    assert configuration.method == "rbpf"
    assert configuration.lidar.max_range == PRESETS["sick"].max_range
    assert configuration.lidar.usable_range == 6.0


@pytest.fixture
def at(tmp_path, monkeypatch):
    """In a folder with a study that can be read, whose log is not driven through."""
    monkeypatch.chdir(tmp_path)
    Path("plan.toml").write_text(PLAN, encoding="utf-8")
    monkeypatch.setattr("jaxslam.study.keep_programs", lambda folder: None)
    monkeypatch.setattr("jaxslam.study.with_lidars", lambda plan: plan)
    monkeypatch.setattr("jaxslam.study.with_few_programs", lambda plan: plan)
    return tmp_path


@pytest.mark.parametrize(
    ("change", "flags", "message"),
    [
        (
            ("sensor.sigma_hit", "sensor.sigma_hti"),
            [],
            "'sensor.sigma_hti': did you mean 'sensor.sigma_hit'?",
        ),
        ((SPACE, ""), [], "the space is empty: give [space] some settings"),
        (("trials = 500", "trails = 8"), [], "[study] has no 'trails': did you mean 'trials'?"),
        (("hall_small", "hal_small"), [], "did you mean 'hall_small'?"),
        (("", ""), ["--trials", "0"], "--trials is 0: give 1 or more"),
        (("", ""), ["--trials", "many"], "--trials"),
        (("", ""), ["--storage", "."], "unable to open database file"),
        (
            ("", ""),
            ["--storage", "plan.toml/a.db"],
            "plan.toml: is a file, not a folder: give another with --storage",
        ),
        (("", ""), ["--storage", "plan.toml"], "file is not a database"),
        (
            ("", ""),
            ["--storage", "/proc/study.db"],
            "/proc: cannot be written to (No such file or directory): give another with --storage",
        ),
        (
            ("", ""),
            ["--storage", "mysql://me:secret@host/x"],
            "mysql://me:***@host/x: this storage cannot be",
        ),
        (("", ""), ["--out", "plan.toml"], "plan.toml: is a file, not a folder: give another with --out"),
        (("", ""), ["--cluster", "local:x"], "--cluster is 'local:x': give local:N, with N processes"),
        (("", ""), ["--cluster", "tcp://127.0.0.1:1"], "no Dask scheduler answers at tcp://127.0.0.1:1: "),
        (("", ""), ["--cluster", "tcp://10.1.2.3:8786"], "is a file of this machine, which the workers of"),
    ],
)
def test_bad_input_is_one_line(at, monkeypatch, capsys, change, flags, message):
    monkeypatch.setattr("jaxslam.study.workers.CONNECT", 0.2)
    Path("plan.toml").write_text(PLAN.replace(*change), encoding="utf-8")
    assert main(["study", "plan.toml", *flags]) == 2
    assert message in error_line(capsys)


def test_files_that_are_missing(at, capsys):
    assert main(["study", "missing.toml"]) == 2
    assert "missing.toml: no such file: check the path, or give a study in TOML" in error_line(capsys)
    assert main(["study", "report", "missing.db"]) == 2
    assert "missing.db does not exist: give the storage" in error_line(capsys)
    assert not Path("missing.db").exists()
    Path("plan.toml").write_text(
        PLAN.replace('world = "hall_small"\nduration = 10\n[[h', 'log = "no.bag"\n[[h')
    )
    assert main(["study", "plan.toml"]) == 2
    assert "no.bag does not exist" in error_line(capsys)
    assert not Path("runs").exists()
