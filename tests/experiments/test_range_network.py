"""The range-network experiment in a small corridor, and its measures by hand."""

import json

import jax.numpy as jnp
import numpy as np

from experiments.range_network.devices import Quality, calibration, device
from experiments.range_network.runs import BACK, SMALL_LOOP, small_loops
from jaxslam.sim import lds_01, lds_01_accuracy
from tests.experiments.smoke import run_smoke


def test_it_runs_and_writes_tables_and_figures(tmp_path):
    run_smoke("range_network", tmp_path)
    table = (tmp_path / "table.md").read_text()
    # Four tables with a head each; three trainings, one number of particles, twice that, one device.
    assert table.count("\n| ") == 4 + 3 + 1 + 2 + 1
    assert "nan" not in table
    assert (tmp_path / "maps.png").stat().st_size > 20_000
    for figure in ("errors", "histograms", "readings", "deviations"):
        assert (tmp_path / f"training/{figure}.png").stat().st_size > 10_000
    with np.load(tmp_path / "raw/with-5-bias100-noise100.npz") as cell:
        assert cell["closed"].shape == (2,)
        assert cell["rmse"].max() < 0.5
    with np.load(tmp_path / "raw/training-levenberg-marquardt.npz") as cell:
        assert (cell["held_out"] < 0.95 * cell["held_out_raw"]).all()
    assert len(json.loads((tmp_path / "raw/times.json").read_text())["times"]) == 2


def test_devices_are_within_the_data_sheet():
    distances = jnp.linspace(0.12, 3.5, 50, dtype=jnp.float32)
    for unit in range(3):
        lidar = device(Quality(bias=1.0, noise=1 / 3), unit)
        assert lidar.bias is not None
        assert (jnp.abs(lidar.bias(distances)) <= lds_01_accuracy(distances) + 1e-6).all()
        np.testing.assert_allclose(lidar.sigma_proportional, lds_01().sigma_proportional, rtol=1e-6)
    np.testing.assert_allclose(device(Quality(0.0, 1.0), 0).sigma_constant, 0.01, rtol=1e-6)
    assert device(Quality(0.0, 1.0), 0).bias is None


def test_calibrations_differ_by_device_only():
    lidar = device(Quality(0.5, 1.0), 0)
    first, again, other = (calibration(lidar, unit, num_readings=50) for unit in (0, 0, 1))
    np.testing.assert_array_equal(first.measured, again.measured)
    assert len(first.distances) == 35
    assert first.measured[:100].tolist() != other.measured[:100].tolist()


def test_small_loops_go_forth_and_back_and_round():
    tour = np.array([[0.0, 0.0], [20.0, 0.0], [20.0, 10.0], [0.0, 10.0]])
    points = small_loops(tour)
    closed = np.vstack([points, points[:1]])
    path = np.hypot(*np.diff(closed, axis=0).T).sum()
    # Every stretch but the ends is driven thrice where half is driven back.
    assert path > 2.0 * 60.0
    np.testing.assert_allclose(points[0], tour[0])
    assert SMALL_LOOP > BACK
    # Always on the tour.
    on_a_side = (np.isin(points[:, 0], (0.0, 20.0))) | (np.isin(points[:, 1], (0.0, 10.0)))
    assert on_a_side.all()
    assert (np.hypot(*np.diff(points, axis=0).T) > 0).all()
