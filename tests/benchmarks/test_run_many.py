"""How long `run_many` takes for several configurations and seeds: compiling, and run after run.

    pytest tests/benchmarks/test_run_many.py --benchmark-only

The times in `extra_info` are those that `run_many` reports of itself; compiling includes tracing there, with
the shape checks of the test suite.
"""

import statistics

import jax
import numpy as np
import pytest

from jaxslam.many import run_many
from tests.benchmarks.filters import prepared_drive

NUM_ROUNDS = 3


@pytest.mark.parametrize(("num_configurations", "num_keys"), [(1, 4), (4, 4), (16, 4)])
def test_run_many(benchmark, num_configurations, num_keys):
    prepared = prepared_drive("gmapping", 15)
    keys = jax.random.split(jax.random.key(0), num_keys)
    configurations = {"sensor.sigma_hit": np.linspace(0.08, 0.12, num_configurations).tolist()}
    results = []
    benchmark.group = "run many"
    benchmark.pedantic(
        lambda: results.append(run_many(prepared.slam, keys, configurations, prepared.inputs)),
        rounds=NUM_ROUNDS,
        warmup_rounds=1,
    )
    assert not results[-1].left_map.any()
    benchmark.extra_info.update(
        num_runs=num_configurations * num_keys,
        num_scans=results[-1].trajectories.shape[2],
        num_devices=len(jax.devices()),
        compile_s=results[0].compile_s,
        steady_ms=1e3 * statistics.median(result.run_s for result in results[1:]),
        scans_per_second=statistics.median(result.scans_per_s for result in results[1:]),
        device=jax.devices()[0].device_kind,
    )
