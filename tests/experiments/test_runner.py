"""`python -m experiments`, and the page that it writes."""

import json
import re
import shutil

import numpy as np
import pytest

import experiments
from experiments import __main__ as runner
from experiments._harness.harness import Cell
from experiments._harness.results import Table
from experiments.paper_tables.catalogue import EXPERIMENTS, FOLDER, Experiment
from experiments.paper_tables.page import PAGE, render, write_page
from experiments.paper_tables.papers import JAMALUDIN, PAPERS, TABLE_II, Gain
from experiments.range_network import __main__ as range_network

BIBLIOGRAPHY = "../docs/bibliography.md"

TINY = """
from experiments._harness.harness import Cell, compute, parse_options, write_results
from tests.experiments.test_harness import square

QUESTION = "How much is three times three?"


def main(arguments=None):
    options = parse_options("tiny", QUESTION, seeds=3, arguments=arguments)
    results = compute([Cell("three", {"number": 3, "short": options.smoke})], square, options)
    table = f"| of | is |\\n|---|---|\\n| 3 | {results['three']['value']} |\\n"
    write_results(options, f"Squares:\\n\\n{table}", 1.0)
"""


@pytest.fixture
def tiny(tmp_path, monkeypatch):
    """Replace all experiments by one that takes a second; return its folder."""
    folder = tmp_path / "packages" / "tiny"
    folder.mkdir(parents=True)
    (folder / "__init__.py").touch()
    (folder / "__main__.py").write_text(TINY)
    monkeypatch.setattr(experiments, "__path__", [*experiments.__path__, str(folder.parent)])
    only = {"tiny": Experiment("tiny", "Liang et al.", hours=0.5)}
    monkeypatch.setattr("experiments.paper_tables.catalogue.EXPERIMENTS", only)
    monkeypatch.setattr(runner, "EXPERIMENTS", only)
    return folder


def test_it_lists_every_experiment(capsys):
    assert runner.main([]) == 0
    listed = capsys.readouterr().out
    for experiment in EXPERIMENTS.values():
        assert f"{experiment.name} (paper: {experiment.paper}), about {experiment.hours:g} h" in listed
        assert experiment.question in listed
    assert re.search(r"results: 10 seeds, drives of 200 s, .*jax \d+\.\d+\.\d+", listed)


def test_the_list_names_the_command_for_missing_results(tiny, capsys):
    assert runner.main(["list"]) == 0
    assert capsys.readouterr().out == (
        "tiny (paper: Liang et al.), about 0.5 h on two cores\n"
        "    How much is three times three?\n"
        "    results: none yet: python -m experiments run tiny\n"
    )


def test_the_catalogue_has_every_package():
    packages = {path.parent.name for path in FOLDER.glob("*/__main__.py")}
    assert set(EXPERIMENTS) == packages
    for name, experiment in EXPERIMENTS.items():
        assert experiment.name == name
    assert {(paper.name, paper.experiment) for paper in PAPERS} == {
        (experiment.paper, experiment.name) for experiment in EXPERIMENTS.values()
    }


def test_it_runs_one_and_records_its_command_and_settings(tiny, tmp_path, capsys):
    out = tmp_path / "out"
    assert runner.main(["run", "tiny", "--smoke", "--out", str(out), "--workers", "1"]) == 0
    assert "| 3 | 9 |" in (out / "tiny" / "table.md").read_text()
    assert "| 3 | 9 |" in capsys.readouterr().out
    origin = json.loads((out / "tiny" / "run.json").read_text())
    assert origin["command"] == "python -m experiments.tiny --smoke --out DIR"
    assert (origin["seeds"], origin["duration_s"]) == (2, 1.0)
    cells = json.loads((out / "tiny" / "cells.json").read_text())
    settings = {"number": 3, "short": True}
    assert cells == {"three": {"digest": Cell("three", settings).digest, "settings": settings}}


def test_it_runs_several_in_turn_with_their_flags(monkeypatch, tmp_path):
    asked = []
    monkeypatch.setattr(
        Experiment, "main", property(lambda self: lambda flags: asked.append((self.name, flags)))
    )
    assert runner.main(["run"]) == 0
    assert asked == [(name, []) for name in EXPERIMENTS]
    asked.clear()
    flags = ["--seeds", "3", "--workers", "1", "--fresh", "--smoke", "--out", str(tmp_path)]
    assert runner.main(["run", "coal_mine", "tobacco_line", "coal_mine", *flags]) == 0
    assert [name for name, _ in asked] == ["coal_mine", "tobacco_line"]
    assert sorted(asked[0][1]) == sorted([*flags[:-1], str(tmp_path / "coal_mine")])


def test_an_unknown_name_suggests_the_closest(capsys):
    assert runner.main(["run", "coal_mine", "tabacco_line"]) == 2
    complaint = capsys.readouterr().err
    assert complaint.count("\n") == 1
    assert "no experiment is called 'tabacco_line': did you mean 'tobacco_line'?" in complaint


def test_a_missing_dependency_is_reported_before_anything_runs(monkeypatch, capsys):
    def missing(self):
        raise ModuleNotFoundError("No module named 'optax'", name="optax")

    monkeypatch.setattr(Experiment, "_module", missing)
    assert runner.main(["run"]) == 2
    assert capsys.readouterr().err == (
        "experiments: error: optax is not installed: python -m pip install -e '.[cli,train,vision]'\n"
    )
    assert runner.main([]) == 0
    assert "needs optax" in capsys.readouterr().out


@pytest.mark.parametrize("arguments", [["go"], ["run", "--seeds", "1.5"], ["run", "coal_mine", "--smoke"]])
def test_flags_that_make_no_sense_are_refused(arguments, capsys):
    with pytest.raises(SystemExit) as stop:
        runner.main(arguments)
    assert stop.value.code == 2
    assert "error" in capsys.readouterr().err


def test_the_committed_page_is_that_of_the_committed_results():
    committed = (FOLDER / PAGE).read_text(encoding="utf-8")
    assert committed == render(), "bring it up to date: python -m experiments page"
    # The page reports a missing row of a table in these words.
    assert "in `table.md`" not in committed


def test_everything_that_the_page_links_to_is_there():
    targets = re.findall(r"\]\(([^)]+)\)", (FOLDER / PAGE).read_text(encoding="utf-8"))
    assert len(targets) > 15
    if not (FOLDER.parent / "docs").is_dir():  # a source distribution has no docs
        targets.remove(BIBLIOGRAPHY)
    for target in targets:
        assert (FOLDER / target).is_file(), target


def test_settings_of_the_committed_results_are_complete():
    for experiment in EXPERIMENTS.values():
        path = experiment.results() / "cells.json"
        if not (experiment.results() / "table.md").exists():
            continue
        assert path.exists(), f"with results/raw there, {experiment.command} writes it in a minute"
        for name, cell in json.loads(path.read_text()).items():
            assert Cell(name, cell["settings"]).digest == cell["digest"], name


def test_without_results_the_page_has_the_papers_and_the_commands(tmp_path):
    missing = write_page(tmp_path)
    assert missing == [
        f"{name}: no results yet: python -m experiments run {name}"
        for name in ("tobacco_line", "coal_mine", "range_network")
    ]
    page = (tmp_path / PAGE).read_text(encoding="utf-8")
    for paper in PAPERS:
        for item in paper.items:
            assert f"| {item.name} | {item.shows} | not available yet |" in page
    assert page.count("**No results yet:**") == 3
    assert "python -m experiments run coal_mine" in page
    # The page links to the bibliography and to the experiments, but to no file of the missing results.
    assert re.findall(r"\]\(([^)]+)\)", page) == [
        BIBLIOGRAPHY,
        *(f"{name}/README.md" for name in EXPERIMENTS),
    ]


def test_the_page_shows_results_of_the_range_network_once_they_are_complete(tmp_path, monkeypatch):
    results = tmp_path / "range_network" / "results"
    monkeypatch.setattr(range_network, "compute", lambda cells, work, options: {c.name: CELL for c in cells})
    monkeypatch.setattr(range_network.runs, "inliers", lambda cell, reference: np.array([50, 51]))
    monkeypatch.setattr(
        range_network, "milliseconds_per_scan", lambda names, prepare, options: dict.fromkeys(names, 4.5)
    )
    monkeypatch.setattr(range_network, "draw_loops", lambda path, *_: path.write_bytes(b""))

    def write_training_figures(options):
        for item in JAMALUDIN.items:
            for file in item.files:
                path = options.out / file
                path.parent.mkdir(exist_ok=True)
                path.touch()

    monkeypatch.setattr(range_network, "_write_training_figures", write_training_figures)
    results.mkdir(parents=True)
    range_network.main(["--out", str(results)])
    page = render(tmp_path)
    assert "in `table.md`" not in page
    paper = "Without the network 0/10 loops closed, 53 inliers; with it 10/10, 58"
    assert f"| Table II, 30 particles | {paper} | without: 1/2 closed, 50.5 inliers" in page
    assert "without: 1/2 closed, 50.5 inliers (50.5 on the map from known poses)" in page
    assert "without the network, 400 particles: 15.00 × 42.00 m" in page
    assert "`python -m experiments.range_network --seeds 10`" in page
    assert page.count("![") == 6
    assert write_page(tmp_path)[2:] == []


CELL = {
    **dict.fromkeys(("seconds", "steps", "mse_learnt", "held_out", "held_out_noise"), np.array([0.01, 0.02])),
    **dict.fromkeys(("held_out_raw", "loop_position", "walls_once", "rmse"), np.array([0.3, 0.4])),
    **dict.fromkeys(("cpu_seconds", "map_megabytes", "peak_megabytes"), np.array([100.0, 200.0])),
    "closed": np.array([True, False]),
    "extent": np.array([[42.0, 15.0], [42.0, 15.0]]),
}
"""Replaces each cell of the range-network experiment: two trials, or two lidars."""


def test_the_page_names_missing_rows_and_files(tmp_path):
    results = tmp_path / "coal_mine" / "results"
    shutil.copytree(EXPERIMENTS["coal_mine"].results(), results, ignore=shutil.ignore_patterns("raw"))
    (results / "maps.png").unlink()
    table = (results / "table.md").read_text(encoding="utf-8")
    (results / "table.md").write_text(table.replace("| kidnapped | built |", "| kidnapped | other |"))
    assert "coal_mine: maps.png (Figures 7 and 8) is missing: python -m experiments run coal_mine" in (
        write_page(tmp_path)
    )
    page = (tmp_path / PAGE).read_text(encoding="utf-8")
    assert "`maps.png`: not available yet" in page
    assert "no 'kidnapped, built' in `table.md`: `python -m experiments run coal_mine`" in page


def test_broken_results_are_a_line_and_not_a_traceback(tmp_path):
    results = tmp_path / "coal_mine" / "results"
    results.mkdir(parents=True)
    (results / "run.json").write_text("{")
    with pytest.raises(ValueError, match=r"run\.json: not valid JSON"):
        render(tmp_path)


def test_table_two_is_the_same_everywhere():
    for count, (without, inliers_without, closed, inliers) in TABLE_II.items():
        numbers = (without, float(inliers_without), closed, float(inliers))
        assert numbers == range_network.PAPER[int(count)]


def test_the_gain_over_table_two_is_the_printed_one():
    rows = tuple((count, *numbers) for count, numbers in TABLE_II.items())
    table = Table(("particles", "closed", "inliers", "with", "inliers (2)"), rows)
    assert Gain("{}", "II", "inliers (2)", "inliers").read({"II": table}) == "+25.17 %"
