"""A short drive with few beams, and a small filter for it that compiles fast."""

import jax
import numpy as np

from jaxslam.grid import GridSpec, OccupancyModel
from jaxslam.io.log import SensorLog
from jaxslam.motion import OdometryMotion
from jaxslam.pipeline.inputs import PreparedScans
from jaxslam.proposal.base import AbstractProposal
from jaxslam.resampling import AdaptiveResampling, SystematicResampler
from jaxslam.sensor import LikelihoodField
from jaxslam.sim import Lidar, hall_small, simulate, to_log
from jaxslam.slam import RBPF

NUM_BEAMS = 24


def drive(seed: int, duration: float, rate: float = 10.0) -> SensorLog:
    """Return the log of a drive through the small hall, with `rate` scans per second."""
    world, waypoints = hall_small()
    lidar = Lidar(
        num_beams=NUM_BEAMS,
        angle_min=-np.pi,
        angle_increment=2 * np.pi / NUM_BEAMS,
        range_min=0.05,
        range_max=4.0,
        sigma_constant=0.01,
        rate=rate,
    )
    return to_log(simulate(jax.random.key(seed), world, waypoints, lidar=lidar, duration=duration))


def small_filter(
    prepared: PreparedScans, proposal: AbstractProposal, *, num_particles: int, threshold: float
) -> RBPF:
    bounds = prepared.odometry_bounds
    return RBPF(
        grid=GridSpec.covering(bounds[0] - 5.0, bounds[1] + 5.0, 0.1),
        motion=OdometryMotion(),
        sensor=LikelihoodField(max_beams=NUM_BEAMS),
        proposal=proposal,
        resampling=AdaptiveResampling(SystematicResampler(), threshold),
        occupancy=OccupancyModel(),
        usable_range=3.0,
        num_particles=num_particles,
        window_size=64,
    )
