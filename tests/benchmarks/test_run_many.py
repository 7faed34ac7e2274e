"""What `run_many` gains over one run after another: 64 configurations and 10 keys of a small world.

    pytest tests/benchmarks/test_run_many.py --benchmark-only

The times in `extra_info` are those that are reported by the runs themselves; compiling includes tracing
there, with the shape checks of the test suite.
"""

import statistics

import jax
import numpy as np
import pytest

from jaxslam.config.dotted import update
from jaxslam.pipeline.many import run_many
from jaxslam.pipeline.run import run_log
from tests.benchmarks.filters import prepared_drive

NUM_PARTICLES, DURATION = 5, 6.0
"""A drive of 20 scans or so."""
NUM_CONFIGURATIONS, NUM_KEYS = 64, 10
NUM_ALONE = 8
"""Configurations that are run one after another, which says as much as all of them."""
NUM_ROUNDS = 2
"""Of half a minute each."""
VALUES = np.geomspace(0.05, 0.3, NUM_CONFIGURATIONS).tolist()


@pytest.fixture(scope="module")
def drive():
    return prepared_drive("gmapping", NUM_PARTICLES, DURATION)


def test_one_after_another(benchmark, drive):
    slam, scans = drive
    keys = jax.random.split(jax.random.key(0), NUM_KEYS)
    filters = [update(slam, {"sensor.sigma_hit": value}) for value in VALUES[:NUM_ALONE]]
    first = run_log(filters[0], scans, keys[0])
    assert np.isfinite(first.trajectory).all()
    benchmark.group = "many runs"
    benchmark.pedantic(
        lambda: [run_log(each, scans, key) for each in filters for key in keys], rounds=NUM_ROUNDS
    )
    num_scans = NUM_ALONE * NUM_KEYS * len(scans.stamps)
    benchmark.extra_info.update(
        num_runs=NUM_ALONE * NUM_KEYS,
        num_scans=len(scans.stamps),
        compile_s=first.compile_s,
        scans_per_second=num_scans / benchmark.stats.stats.median,
        device=jax.devices()[0].device_kind,
    )


@pytest.mark.parametrize("together", [1, 2, 8])
@pytest.mark.parametrize("num_devices", [1, 2])
def test_run_many(benchmark, drive, num_devices, together):
    slam, scans = drive
    keys = jax.random.split(jax.random.key(0), NUM_KEYS)
    devices = jax.devices()[:num_devices]
    if len(devices) < num_devices:
        pytest.skip(f"there is {len(devices)} device")
    results = []

    def run(values):
        configurations = {"sensor.sigma_hit": values}
        results.append(run_many(slam, scans, keys, configurations, together=together, devices=devices))

    benchmark.group = "many runs"
    # One configuration compiles what all need.
    run(VALUES[:1])
    benchmark.pedantic(run, args=(VALUES,), rounds=NUM_ROUNDS)
    assert not results[-1].left_map.any()
    benchmark.extra_info.update(
        num_runs=NUM_CONFIGURATIONS * NUM_KEYS,
        num_scans=results[-1].trajectories.shape[2],
        compile_s=results[0].compile_s,
        compile_again_s=results[-1].compile_s,
        steady_ms=1e3 * statistics.median(result.run_s for result in results[1:]),
        scans_per_second=statistics.median(result.scans_per_s for result in results[1:]),
        device=jax.devices()[0].device_kind,
    )
