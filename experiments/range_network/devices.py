"""Cheap lidars within the limits of their data sheet, and the networks that correct their ranges."""

import functools
from dataclasses import dataclass

import equinox as eqx
import jax
import numpy as np

from jaxslam.range_network import RangeNetwork
from jaxslam.range_network.learning import Method, Split, TrainingResult, learn
from jaxslam.range_network.readings import Readings
from jaxslam.sim import Lidar, calibration_distances, calibration_run, draw_lds_01_bias, lds_01


@dataclass(frozen=True)
class Quality:
    """Errors of a device relative to the limits of the data sheet of the LDS-01.

    Attributes:
        bias: largest bias, as a fraction of the accuracy (±15 mm to 0.5 m, up to ±5 % beyond).
        noise: standard deviation, as a fraction of the precision (±10 mm to 0.5 m, up to ±3.5 % beyond): with
            1/3, nearly all readings lie within the precision; with 1, two thirds of them do.
    """

    bias: float
    noise: float


@functools.cache
def device(quality: Quality, unit: int) -> Lidar:
    """Return one lidar, whose bias is drawn with the key `unit`."""
    lidar = lds_01(draw_lds_01_bias(jax.random.key(unit), quality.bias) if quality.bias else None)
    # In the preset, the precision is three standard deviations.
    scale = 3.0 * quality.noise
    return eqx.tree_at(
        lambda made: (made.sigma_constant, made.sigma_proportional),
        lidar,
        (scale * lidar.sigma_constant, scale * lidar.sigma_proportional),
    )


def calibration(lidar: Lidar, unit: int, num_readings: int = 2000) -> Readings:
    """Simulate the calibration of Jamaludin et al.: a wall at 0.12 to 3.5 m in steps of 0.1 m."""
    distances = calibration_distances(lidar)
    key = jax.random.fold_in(jax.random.key(unit), 2**32 - 3)
    ranges, valid = calibration_run(key, lidar, distances, num_readings)
    returned = np.asarray(valid)
    true = np.broadcast_to(np.asarray(distances, np.float64)[:, None], returned.shape)
    return Readings(true[returned], np.asarray(ranges, np.float64)[returned], int((~returned).sum()))


def learnt(
    quality: Quality, unit: int, method: Method = "levenberg-marquardt", restarts: int = 5
) -> TrainingResult:
    """Train 50 neurons on the calibration of one lidar."""
    readings = calibration(device(quality, unit), unit)
    return learn(
        jax.random.key(unit), readings, Split.from_readings(readings), restarts=restarts, method=method
    )


@functools.cache
def network(quality: Quality, unit: int) -> RangeNetwork:
    """Return the network that corrects the ranges of one lidar."""
    return learnt(quality, unit).network
