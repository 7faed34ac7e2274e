"""How long a scan takes in a known map: the scan model alone, and a whole step with its resampling.

    pytest tests/benchmarks/test_localization.py --benchmark-only

A step of as many particles as there is room for, in the small hall; `extra_info` has the beams per second.
"""

import jax
import jax.numpy as jnp
import pytest

from tests.benchmarks.localizers import localization_step, sensor_model
from tests.benchmarks.programs import measure

PROGRAMS = {"sensor model": sensor_model, "localization step": localization_step}


@pytest.mark.parametrize(
    ("num_particles", "num_beams"), [(500, 60), (2_000, 60), (10_000, 60), (100_000, 100)]
)
@pytest.mark.parametrize("name", PROGRAMS)
def test_localization(benchmark, name, num_particles, num_beams):
    result = measure(
        benchmark,
        PROGRAMS[name](num_particles, num_beams),
        group=name,
        rounds=30,
        warm_up=3,
        stage=name,
        num_particles=num_particles,
        num_beams=num_beams,
    )
    # A step that fails is fast.
    assert all(bool(jnp.isfinite(leaf).any()) for leaf in jax.tree.leaves(result))
    seconds = 1e-3 * benchmark.extra_info["steady_ms"]
    benchmark.extra_info["beams_per_second"] = num_particles * num_beams / seconds
