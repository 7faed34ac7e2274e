"""A filter in the middle of a run, as the benchmarks of its stages need it."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np

from jaxslam.configuration import Configuration, build, correct_scans
from jaxslam.inputs import PreparedInputs, prepare_inputs
from jaxslam.run import run
from jaxslam.sim import make_world, sick, simulate, to_log
from jaxslam.slam import RBPF, RBPFState
from jaxslam.types import StepInputs

NUM_DISTINCT = 8
"""Particles that really ran; larger sets repeat them. What a stage costs does not depend on it."""
DURATION = 30.0
"""Seconds driven before the clock starts: the window around the robot is well filled by then."""


@functools.cache
def _prepared(configuration: Configuration) -> PreparedInputs:
    world, waypoints = make_world("hall_small")
    # As real SICK logs of one degree often have it: 180 beams, not 181.
    lidar = dataclasses.replace(sick(), num_beams=180)
    simulation = simulate(jax.random.key(1), world, waypoints, lidar=lidar, duration=DURATION)
    log = to_log(simulation, "benchmark")
    return prepare_inputs(correct_scans(log, configuration.lidar)[0], configuration.thinning)


@functools.cache
def _after_a_while(configuration: Configuration) -> tuple[RBPF, RBPFState, StepInputs]:
    prepared = _prepared(configuration)
    slam = build(configuration, prepared.odometry_bounds)
    pose0 = jnp.asarray(prepared.pose0, jnp.float32)
    before, now = (
        jax.tree.map(lambda leaf, part=part: leaf[part], prepared.inputs) for part in (slice(-1), -1)
    )
    state, _ = jax.jit(run)(slam, jax.random.key(0), pose0, before)
    return slam, state, now


def running_filter(num_particles: int) -> tuple[RBPF, RBPFState, StepInputs]:
    """A filter with default settings and a SICK, its state after a drive, and the next step's inputs.

    The log-weights are such that about half of the particles count, which is when resampling sets in.
    """
    # Maps of a path in one hall: the margin of the defaults would only fill the memory.
    configuration = dataclasses.replace(Configuration(), num_particles=NUM_DISTINCT)
    configuration = dataclasses.replace(configuration, map=dataclasses.replace(configuration.map, margin=4.0))
    slam, few, inputs = _after_a_while(configuration)
    chosen = np.arange(num_particles) % NUM_DISTINCT
    # ESS / N of weights exp(s z) tends to exp(−s²): one half at s = 0.83.
    log_weights = 0.83 * np.random.default_rng(0).standard_normal(num_particles)
    state = RBPFState(
        maps=few.maps[chosen],
        poses=few.poses[chosen],
        log_weights=jax.nn.log_softmax(jnp.asarray(log_weights, jnp.float32)),
        num_steps=few.num_steps,
    )
    return dataclasses.replace(slam, num_particles=num_particles), state, inputs
