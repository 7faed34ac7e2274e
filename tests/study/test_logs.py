"""A trial on a log: read, cut, mapped and measured."""

import dataclasses
import json

import jax
import numpy as np

from jaxslam.config.lidar_presets import detect_lidar
from jaxslam.config.toml import read_settings
from jaxslam.io import write_tum
from jaxslam.sim import make_world, sick, simulate, to_log
from jaxslam.study.measure import load, measure
from jaxslam.study.plan import Source, read_plan
from jaxslam.study.report import write_configuration
from jaxslam.study.search import with_lidars
from tests.study.studies import FILTER, LOGS, SPACE, STUDY, write_plan


def test_the_first_minute_of_a_real_log(tmp_path, data_dir):
    folder = data_dir / "carmen"
    whole = Source("csail", log=str(folder / "csail.clf.gz"), reference=str(folder / "csail.reference.tum"))
    source = dataclasses.replace(whole, duration=60.0)
    loaded = load(source)
    stamps = loaded.log.scans.stamps
    assert 50.0 < stamps[-1] - stamps[0] <= 60.0
    assert len(load(whole).log.scans.stamps) > 2 * len(stamps)

    plan = read_plan(write_plan(tmp_path, STUDY, LOGS, SPACE, FILTER))
    plan = dataclasses.replace(plan, sources=(source,))
    good, bad = measure(plan, source, (0, 1), [{}, {"sensor.sigma_hit": 5.0}])
    # The filter keeps to the reference for so long; one to which all poses look alike does not.
    assert good.error.shape == (2,)
    assert good.error.max() < 0.1
    assert bad.error.min() > 2 * good.error.max()
    assert np.isfinite(good.ms_per_scan)


def test_a_log_of_a_lidar_that_nobody_knows(tmp_path, monkeypatch):
    """What its scans tell is a part of the plan, and of the best configuration."""
    world, waypoints = make_world("hall_small")
    lidar = dataclasses.replace(sick(), num_beams=97, range_max=13.0)
    simulation = simulate(jax.random.key(1), world, waypoints, lidar=lidar, duration=10.0)
    log = to_log(simulation, in_world_frame=True)
    truth = (log.scans.stamps, np.asarray(simulation.scan_poses, np.float64))
    assert detect_lidar(log).name == "generic"
    write_tum(tmp_path / "truth.tum", *truth)
    monkeypatch.setattr("jaxslam.study.measure.read_log", lambda path: log)
    source = Source("own", log=str(tmp_path / "own.log"), reference=str(tmp_path / "truth.tum"))
    plan = read_plan(write_plan(tmp_path, STUDY, LOGS, SPACE, FILTER))
    plan = with_lidars(dataclasses.replace(plan, sources=(source,)))
    assert plan.sources[0].lidar == detect_lidar(log)

    [found] = measure(plan, plan.sources[0], (0,), [{}])
    assert found.error[0] < 0.1
    stored = json.loads(json.dumps(plan.described()))
    write_configuration(tmp_path / "best.toml", stored, {"lidar.usable_range": 5.0})
    best = read_settings(tmp_path / "best.toml")
    assert (best["lidar.usable_range"], best["lidar.max_range"]) == (5.0, 13.0)
