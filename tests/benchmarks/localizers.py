"""A localization in the middle of a run, as the benchmarks need it."""

import dataclasses

import jax
import jax.numpy as jnp

from jaxslam.config.localization import LocalizationConfig
from jaxslam.core.types import StepInputs
from jaxslam.localization import AMCL, AMCLState
from jaxslam.pipeline.build import build_localizer
from jaxslam.sensor import LikelihoodField
from tests.benchmarks.filters import one_step
from tests.benchmarks.programs import Program
from tests.builders import hall_map


def localizer(num_particles: int, num_beams: int) -> tuple[AMCL, AMCLState, StepInputs]:
    """The filter with all its particles alive and resampling in every step, and a scan."""
    configuration = dataclasses.replace(
        LocalizationConfig(),
        max_particles=num_particles,
        resample_below=1.01,
        sensor=LikelihoodField(sigma_hit=0.2, unseen_beams=0.0, independent_beams=5.0, max_beams=num_beams),
    )
    amcl = build_localizer(configuration, hall_map()[0])
    state = amcl.init(
        jax.random.key(0), jnp.asarray([4.0, 4.0, 0.0]), jnp.diag(jnp.asarray([0.25, 0.25, 0.1]))
    )
    return amcl, state, one_step(num_beams)


def sensor_model(num_particles: int, num_beams: int) -> Program:
    """A scan seen from every particle, and no more."""
    amcl, state, inputs = localizer(num_particles, num_beams)

    def score(model, map, prepared, scan, poses):
        return model.log_prob_all(prepared, scan, map.to_map(poses))

    arguments = (amcl.sensor, amcl.map, amcl.prepared, inputs.scan, state.poses)
    return Program(score, arguments, tuned=False)


def localization_step(num_particles: int, num_beams: int) -> Program:
    """A whole step."""
    amcl, state, inputs = localizer(num_particles, num_beams)
    return Program(AMCL.step, (amcl, jax.random.key(1), state, inputs), tuned=False)
