"""`jaxslam demo` on a short drive."""

import json

import pytest

from jaxslam.cli.main import main

SHORT = ["--duration", "12", "--particles", "3", "--set", "window=8"]


@pytest.mark.parametrize("method", ["gmapping", "fruit-fly"])
def test_a_short_demo_maps_and_measures(method, tmp_path, capsys):
    assert main(["demo", "--method", method, *SHORT, "--out", str(tmp_path)]) == 0
    run = json.loads((tmp_path / "run.json").read_text())
    assert run["configuration"]["map.window"] == 8.0
    assert run["configuration"]["proposal.kind"] == {"gmapping": "matched", "fruit-fly": "fruit_fly"}[method]
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert metrics["ate"]["rmse_m"] < 0.05
    assert metrics["map"]["precision"] > 0.9
    assert (tmp_path / "map.png").stat().st_size > 10_000
    # The first paper's method fuses, and says so; the others use the wheels alone.
    assert ("fused with" in capsys.readouterr().out) == (method == "fruit-fly")


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--world", "hall_smal"], "did you mean 'hall_small'"),
        (["--method", "fruitfly"], "did you mean 'fruit-fly'"),
        (["--duration", "0"], "too short"),
        (["--set", "windo=8"], "did you mean"),
    ],
)
def test_what_there_is_not_is_one_line(flags, message, tmp_path, capsys):
    assert main(["demo", *flags, "--out", str(tmp_path / "new")]) == 2
    assert message in capsys.readouterr().err
