"""The tobacco-line experiment on a drive of a few seconds."""

import json

import numpy as np

from experiments.tobacco_line.figures import DRAWN
from experiments.tobacco_line.methods import ABLATION, COMPARED, EQUAL, evaluations
from jaxslam.config.fusion import FusionSettings
from jaxslam.matching.swarm import FruitFlies
from tests.experiments.smoke import run_smoke


def test_it_runs_and_writes_tables_and_figures(tmp_path):
    run_smoke("tobacco_line", tmp_path)
    table = (tmp_path / "table.md").read_text()
    assert table.count("\n| ") == 1 + len(DRAWN)
    assert "nan" not in table
    for figure in ("maps", "errors", "clouds"):
        assert (tmp_path / f"hall_small-{figure}.png").stat().st_size > 20_000
    with np.load(tmp_path / "raw/hall_small-improved-15.npz") as cell:
        assert cell["position"].shape == (2, 7)
        assert cell["position_rmse"].shape == (2,)
        # Six seconds along the first aisle.
        assert cell["position_rmse"].max() < 0.1
        assert 0.05 < cell["iou"].min() < 1.0
        assert cell["one_clouds"].shape == (3, 15, 3)
    times = json.loads((tmp_path / "raw/times.json").read_text())["times"]
    assert set(times) == set(DRAWN)
    assert min(times.values()) > 0


def test_every_method_is_what_its_name_says():
    for group in (COMPARED, ABLATION, EQUAL):
        for name, method in group.items():
            configuration = method.configuration()
            assert configuration.num_particles == method.particles, name
            assert configuration.method == method.method, name
    improved = COMPARED["improved-15"].configuration()
    assert improved.fusion == FusionSettings(use="auto")
    assert improved.proposal.flies == FruitFlies()
    assert ABLATION["standard-flies"].configuration().proposal.flies == FruitFlies.standard(20, 20)


def test_evaluations_are_equal_where_they_should_be():
    assert evaluations(COMPARED["traditional-30"]) == 30
    # 21 headings, 20 steps of ICP, the draw and its match, a swarm of 401, 20 steps more, the last look.
    assert evaluations(COMPARED["improved-15"]) == 15 * (21 + 20 + 2 + 401 + 20 + 1)
    counts = [evaluations(method) for method in EQUAL.values()]
    assert max(counts) < 1.02 * min(counts)
    standard, best = (evaluations(m) for m in (ABLATION["standard-flies"], COMPARED["improved-15"]))
    assert standard == best
