"""How long a scan takes in a known map: the scan model alone, and a whole step with its resampling.

    pytest tests/benchmarks/test_localization.py -n 0 --benchmark-enable

A step of as many particles as there is room for, in the small hall; `extra_info` has the beams per second.
"""

import dataclasses

import jax
import jax.numpy as jnp
import pytest

from jaxslam.localization import AMCL, FieldModel
from jaxslam.localization_configuration import LocalizationConfiguration, build_localizer
from jaxslam.types import LidarScan, OdometryIncrement, StepInputs
from tests.localization.worlds import hall_map

SIZES = ((500, 60), (2_000, 60), (10_000, 60), (100_000, 100))
NUM_ROUNDS, NUM_WARM_UP = 30, 3


@pytest.mark.parametrize(("num_particles", "num_beams"), SIZES)
def test_scan_model(benchmark, num_particles, num_beams):
    amcl, state, inputs = localizer(num_particles, num_beams)
    everywhere = jnp.ones(num_particles, bool)
    score = jax.jit(lambda model, *rest: model.log_likelihoods(*rest, everywhere, jnp.asarray(True)))
    measure(
        benchmark,
        "scan model",
        (num_particles, num_beams),
        lambda: score(amcl.scan_model, amcl.table, amcl.known, inputs.scan, state.poses),
    )


@pytest.mark.parametrize(("num_particles", "num_beams"), SIZES)
def test_step(benchmark, num_particles, num_beams):
    amcl, state, inputs = localizer(num_particles, num_beams)
    step = jax.jit(AMCL.step)
    measure(
        benchmark,
        "localisation step",
        (num_particles, num_beams),
        lambda: step(amcl, jax.random.key(1), state, inputs),
    )


def localizer(num_particles, num_beams):
    """The filter with all its particles alive and resampling in every step, and a scan."""
    configuration = dataclasses.replace(
        LocalizationConfiguration(),
        max_particles=num_particles,
        resample_below=1.01,
        scan_model=FieldModel(max_beams=num_beams),
    )
    amcl = build_localizer(configuration, hall_map()[0])
    state = amcl.init(
        jax.random.key(0), jnp.asarray([4.0, 4.0, 0.0]), jnp.diag(jnp.asarray([0.25, 0.25, 0.1]))
    )
    scan = LidarScan(
        ranges=jnp.linspace(1.0, 6.0, num_beams),
        valid=jnp.ones(num_beams, bool),
        angle_min=jnp.float32(-1.57),
        angle_increment=jnp.float32(3.14 / num_beams),
        pose_base_lidar=jnp.zeros(3),
    )
    odometry = OdometryIncrement(jnp.asarray([0.2, 0.0, 0.02]), jnp.zeros((3, 3)), jnp.float32(0.2))
    return amcl, state, StepInputs(odometry, scan)


def measure(benchmark, stage, size, call):
    num_particles, num_beams = size
    benchmark.group = stage
    benchmark.extra_info.update(
        stage=stage,
        num_particles=num_particles,
        num_beams=num_beams,
        device=jax.devices()[0].device_kind,
    )
    # A step that fails is fast.
    assert all(bool(jnp.isfinite(leaf).any()) for leaf in jax.tree.leaves(call()))
    benchmark.pedantic(lambda: jax.block_until_ready(call()), rounds=NUM_ROUNDS, warmup_rounds=NUM_WARM_UP)
    seconds = benchmark.stats.stats.median
    benchmark.extra_info["beams_per_second"] = num_particles * num_beams / seconds
