"""How long correcting a scan takes, and training on a whole calibration.

    pytest tests/benchmarks/test_range_network.py -n 0 --benchmark-enable

A scan is corrected so quickly that a call costs more: a thousand corrections, one after the other, are timed.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.range_network import RangeNetwork
from jaxslam.range_network.learning import Split, learn
from jaxslam.range_network.readings import Readings
from jaxslam.sim import calibration_distances, calibration_run, draw_lds_01_bias, lds_01

NUM_CORRECTIONS = 1000


@pytest.mark.parametrize("num_beams", [180, 360, 1080])
def test_thousand_corrections(benchmark, num_beams):
    network = RangeNetwork.draw(jax.random.key(0), 50, 0.1, 3.5)
    ranges = jnp.linspace(0.1, 3.5, num_beams, dtype=jnp.float32)

    def correct_again_and_again(network, ranges):
        return jax.lax.fori_loop(0, NUM_CORRECTIONS, lambda _, ranges: network(ranges), ranges)

    run = jax.jit(correct_again_and_again)
    assert bool(jnp.isfinite(run(network, ranges)).all())
    benchmark.group = "range network"
    benchmark.extra_info.update(num_beams=num_beams, device=jax.devices()[0].device_kind)
    benchmark.pedantic(lambda: jax.block_until_ready(run(network, ranges)), rounds=20, warmup_rounds=2)
    benchmark.extra_info["microseconds_per_scan"] = 1e6 * benchmark.stats.stats.median / NUM_CORRECTIONS


@pytest.mark.parametrize("method", ["levenberg-marquardt", "adam"])
def test_training(benchmark, method):
    """70 000 readings, 50 neurons, one start: compilation is in the warm-up."""
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
    learnt = benchmark.pedantic(
        lambda: learn(jax.random.key(2), readings, split, restarts=1, method=method),
        rounds=3,
        warmup_rounds=1,
    )
    assert np.isfinite(np.asarray(learnt.fit.mse)).all()
