"""Readings of a wall at known distances."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from jaxslam.sim.lidar_sensor import Lidar


def calibration_distances(lidar: Lidar, step: float = 0.1) -> Float[Array, "D"]:
    """Return distances from the shortest range to the longest, both included, meters (35 for an LDS-01)."""
    shortest, longest = float(lidar.range_min), float(lidar.range_max)
    if not (step > 0 and longest > shortest):
        raise ValueError(f"step {step} between {shortest} and {longest} m: give a positive step and span")
    # Stop half a step before the end, so that the last two distances differ.
    return jnp.append(jnp.arange(shortest, longest - step / 2, step, dtype=jnp.float32), longest)


def calibration_run(
    key: PRNGKeyArray, lidar: Lidar, distances: Float[Array, "D"], num_readings: int = 2000
) -> tuple[Float[Array, "D R"], Bool[Array, "D R"]]:
    """Simulate the readings of the beam that faces a wall, at each distance.

    Args:
        key: PRNG key of the noise.
        lidar: the lidar, with noise and bias.
        distances: `[D]` true distances, meters.
        num_readings: number of readings R at each distance.

    Returns:
        Readings and mask as from `Lidar.measure`. Some readings near the limits of the range are invalid.
    """
    return lidar.measure(key, jnp.broadcast_to(distances[:, None], (len(distances), num_readings)))
