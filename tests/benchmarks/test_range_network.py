"""How long correcting a scan takes, and training on a whole calibration.

    pytest tests/benchmarks/test_range_network.py --benchmark-only

A scan is corrected so quickly that a call costs more: a thousand corrections, one after the other, are timed.
"""

import time

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.range_network.learning import Split, learn
from jaxslam.range_network.readings import Readings
from jaxslam.sim import calibration_distances, calibration_run, draw_lds_01_bias, lds_01
from tests.benchmarks.corrections import corrections
from tests.benchmarks.programs import measure

NUM_CORRECTIONS = 1000


@pytest.mark.parametrize("num_beams", [180, 360, 1080])
def test_thousand_corrections(benchmark, num_beams):
    program = corrections(num_beams, NUM_CORRECTIONS)
    corrected = measure(benchmark, program, "range network", rounds=20, warm_up=2, num_beams=num_beams)
    assert bool(jnp.isfinite(corrected).all())
    benchmark.extra_info["us_per_scan"] = 1e3 * benchmark.extra_info["steady_ms"] / NUM_CORRECTIONS


@pytest.mark.parametrize("method", ["levenberg-marquardt", "adam"])
def test_training(benchmark, method):
    """70 000 readings, 50 neurons, one start."""
    lidar = lds_01(draw_lds_01_bias(jax.random.key(0)))
    distances = calibration_distances(lidar)
    ranges, valid = map(np.asarray, calibration_run(jax.random.key(1), lidar, distances))
    true = np.broadcast_to(np.asarray(distances, np.float64)[:, None], ranges.shape)
    readings = Readings(true[valid], ranges[valid].astype(np.float64))
    split = Split.of(readings)
    benchmark.group = "training"
    benchmark.extra_info.update(
        method=method, readings=len(readings.true), device=jax.devices()[0].device_kind
    )

    def train():
        # optax multiplies floats by whole numbers.
        with jax.numpy_dtype_promotion("standard"):
            return learn(jax.random.key(2), readings, split, restarts=1, method=method)

    started = time.perf_counter()
    train()
    first_s = time.perf_counter() - started
    learnt = benchmark.pedantic(train, rounds=3)
    # The first compiles and trains.
    steady_s = benchmark.stats.stats.median
    benchmark.extra_info.update(compile_s=first_s - steady_s, steady_ms=1e3 * steady_s)
    assert np.isfinite(np.asarray(learnt.fit.mse)).all()
