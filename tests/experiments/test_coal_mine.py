"""The coal-mine experiment on a drive of a few meters, and its measures by hand."""

import json

import numpy as np

from experiments._harness.measures import ancestors_left, mean_pose
from experiments.coal_mine.localization import choose_rows
from experiments.coal_mine.mapping import length_error
from experiments.coal_mine.methods import DRAWN, MAPPED
from tests.experiments.smoke import run_smoke


def test_it_runs_and_writes_tables_and_figures(tmp_path):
    run_smoke("coal_mine", tmp_path)
    table = (tmp_path / "table.md").read_text()
    # Two tables with a head each; two methods and three tasks.
    assert table.count("\n| ") == 2 + len(DRAWN) + 3
    assert "nan" not in table
    for figure in ("maps", "particles", "localisation"):
        assert (tmp_path / f"{figure}.png").stat().st_size > 20_000
    with np.load(tmp_path / "raw/map-optimised-15.npz") as cell:
        assert cell["position_rmse"].shape == (2,)
        assert cell["position_rmse"].max() < 0.3
        assert cell["width_error"].max() < 0.3
        assert 1 <= cell["least_ancestors"].min() <= 15
    with np.load(tmp_path / "raw/tracking-built.npz") as cell:
        assert cell["rmse"].max() < 0.15
    assert set(json.loads((tmp_path / "raw/times.json").read_text())["times"]) == set(DRAWN)


def test_every_method_is_what_its_name_says():
    for name, method in MAPPED.items():
        configuration = method.configuration()
        assert configuration.num_particles == method.particles == int(name.rpartition("-")[2])
        assert configuration.method == method.method
        assert configuration.lidar.name == "vlp-16"


def test_trials_are_made_of_the_right_steps():
    truth = np.stack([np.arange(400.0) * 0.2, np.zeros(400), np.zeros(400)], axis=1)
    rng = np.random.default_rng(0)
    np.testing.assert_array_equal(choose_rows("tracking", truth, 60, 150, rng), np.arange(400))
    for _ in range(20):
        rows = choose_rows("global", truth, 60, 150, rng)
        assert len(rows) == 150
        assert (np.diff(rows) == 1).all()
        assert rows[-1] < 400
        rows = choose_rows("kidnapped", truth, 60, 150, rng)
        assert len(rows) == 60 + 150
        assert abs(truth[rows[60 - 1], 0] - truth[rows[60], 0]) > 5.0
        assert np.flatnonzero(np.diff(rows) != 1).tolist() in ([60 - 1], [])


def test_length_error_is_between_the_ends():
    truth = np.array([[0.0, 0.0, 0.0], [50.0, 0.0, 0.0], [70.0, 0.0, 0.0], [30.0, 16.0, 0.0]])
    assert length_error(truth * [1.01, 1.0, 1.0], truth) == np.float64(70.0 * 1.01 - 70.0)


def test_ancestors_by_hand():
    identity = np.arange(4)
    ancestors = np.array([identity, [0, 0, 1, 1], identity, [2, 2, 2, 3]])
    resampled = np.array([False, True, False, True])
    np.testing.assert_array_equal(ancestors_left(ancestors, resampled, 10), [4, 2, 2, 1])
    # Over the last step alone.
    np.testing.assert_array_equal(ancestors_left(ancestors, resampled, 1), [4, 2, 4, 2])


def test_mean_pose_takes_headings_as_directions():
    particles = np.array([[[0.0, 0.0, np.pi - 0.1], [2.0, 0.0, -np.pi + 0.1]]])
    found = mean_pose(particles, np.array([[0.5, 0.5]]))
    np.testing.assert_allclose(found[0, :2], [1.0, 0.0], atol=1e-12)
    assert abs(abs(found[0, 2]) - np.pi) < 1e-9
