"""Filters as the benchmarks need them: in the middle of a run, over a whole drive, before the first step."""

import dataclasses
import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxslam.config.slam import SlamConfig
from jaxslam.core.types import StepInputs
from jaxslam.io.log import SensorLog
from jaxslam.motion import GaussianMotion
from jaxslam.pipeline.build import build_slam
from jaxslam.pipeline.chunks import run_steps
from jaxslam.pipeline.inputs import PreparedScans
from jaxslam.pipeline.prepare import prepare
from jaxslam.sim import make_world, sick, simulate, to_log
from jaxslam.slam import RBPF, RBPFState, StepInfo
from tests.benchmarks.programs import Program
from tests.builders import inputs_of

NUM_BEAMS = 180
"""As real SICK logs of one degree often have it, not 181."""
NUM_DISTINCT = 8
"""Particles that really ran; larger sets repeat them. What a stage costs does not depend on it."""
DURATION = 30.0
"""Seconds driven before the clock starts: the window around the robot is well filled by then."""
MARGIN = 4.0
"""Of the maps: paths in one hall. That of the defaults would only fill the memory."""


@functools.cache
def _log(duration: float) -> SensorLog:
    world, waypoints = make_world("hall_small")
    lidar = dataclasses.replace(sick(), num_beams=NUM_BEAMS)
    simulation = simulate(jax.random.key(1), world, waypoints, lidar=lidar, duration=duration)
    return to_log(simulation, "benchmark")


def _configuration(num_particles: int, method: str = "gmapping") -> SlamConfig:
    chosen = SlamConfig(num_particles=num_particles).with_lidar("sick").with_method(method)
    return dataclasses.replace(chosen, map=dataclasses.replace(chosen.map, margin=MARGIN))


@functools.cache
def _after_a_while() -> tuple[RBPF, RBPFState, StepInputs]:
    slam, scans = prepare(_log(DURATION), _configuration(NUM_DISTINCT))
    key, pose0 = jax.random.key(0), jnp.asarray(scans.pose0, jnp.float32)
    before, now = (jax.tree.map(lambda leaf, part=part: leaf[part], scans.inputs) for part in (slice(-1), -1))
    state, _ = jax.jit(run_steps)(slam, before, key, slam.init(key, pose0))
    return slam, state, now


def running_filter(num_particles: int) -> tuple[RBPF, RBPFState, StepInputs]:
    """A filter with default settings and a SICK, its state after a drive, and the next step's inputs.

    The log-weights are such that about half of the particles count, which is when resampling sets in.
    """
    slam, few, inputs = _after_a_while()
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


def prepared_drive(method: str, num_particles: int, duration: float = DURATION) -> tuple[RBPF, PreparedScans]:
    """A method's filter, and a drive of so many seconds as its inputs."""
    return prepare(_log(duration), _configuration(num_particles, method))


def drive(method: str, num_particles: int) -> Program:
    """A method over the whole drive, as `run` has it."""
    slam, scans = prepared_drive(method, num_particles)
    key = jax.random.key(0)
    return Program(_whole_run, (slam, scans.inputs, key, jnp.asarray(scans.pose0, jnp.float32)))


def _whole_run(
    slam: RBPF, inputs: StepInputs, key: jax.Array, pose0: jax.Array
) -> tuple[RBPFState, StepInfo]:
    return run_steps(slam, inputs, key, slam.init(key, pose0))


def still_filter(num_particles: int, method: str = "gmapping") -> tuple[RBPF, RBPFState, StepInputs]:
    """A filter before its first step: of the sizes of a running one, and ready at once."""
    configuration = _configuration(num_particles, method)
    if configuration.fusion.use != "off":
        # As `prepare` has it for a log with an IMU.
        configuration = dataclasses.replace(configuration, motion=GaussianMotion())
    slam = build_slam(configuration, np.array([[0.0, 0.0], [10.0, 5.0]]))
    return slam, slam.init(jax.random.key(0), jnp.zeros(3)), one_step(NUM_BEAMS)


def still_run(method: str, num_particles: int, num_scans: int) -> Program:
    """`run` over a few equal scans."""
    slam, _, inputs = still_filter(num_particles, method)
    return Program(_whole_run, (slam, repeated(inputs, num_scans), jax.random.key(0), jnp.zeros(3)))


def repeated(tree: Any, count: int) -> Any:
    """Every leaf so many times, along a new first axis."""
    return jax.tree.map(lambda leaf: jnp.repeat(jnp.asarray(leaf)[None], count, axis=0), tree)


def one_step(num_beams: int) -> StepInputs:
    """A scan of half a turn, and a little way driven."""
    ranges = jnp.linspace(1.0, 6.0, num_beams)
    return inputs_of([0.2, 0.0, 0.02], ranges, angle_min=-1.57, increment=3.14 / num_beams)
