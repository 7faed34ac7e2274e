"""How long each method takes over a drive: `run` under `jit`, in the steady state and to compile.

    pytest tests/benchmarks/test_methods.py --benchmark-only

Half a minute in the small hall, with everything that happens on the way: maps that fill, resampling, a
particle that gets lost.
"""

import jax.numpy as jnp
import pytest

from jaxslam.config.slam import METHODS
from jaxslam.core.flags import Flag
from tests.benchmarks.filters import drive
from tests.benchmarks.programs import measure


@pytest.mark.parametrize("num_particles", [15, 30, 100])
@pytest.mark.parametrize("method", METHODS)
def test_method(benchmark, method, num_particles):
    program = drive(method, num_particles)
    num_scans = program.arguments[-1].scan.ranges.shape[0]
    _, infos = measure(
        benchmark,
        program,
        group=f"method {method}",
        rounds=5,
        warm_up=1,
        method=method,
        num_particles=num_particles,
        num_scans=num_scans,
    )
    # A filter that fails is fast.
    assert bool(jnp.isfinite(infos.poses).all())
    assert not bool((infos.flags & Flag.OFF_MAP.value).any())
    benchmark.extra_info["ms_per_scan"] = benchmark.extra_info["steady_ms"] / num_scans
