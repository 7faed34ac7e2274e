"""Range bias of a low-cost lidar, as a function of the distance."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from jaxslam.sim.numeric import Scalar

_LIMITS = (0.12, 3.5)
"""Shortest and longest distance that an LDS-01 measures, meters."""
_NUM_KNOTS = 71
_NUM_WAVES = 4
_KINK = 0.5
"""Distance from which the LDS-01's accuracy interval grows, meters."""


class RangeBias(eqx.Module):
    """A bias that depends on the distance and is the same in every reading of one device.

    Attributes:
        distances: `[K]` true distances, increasing, meters.
        offsets: `[K]` mean reading minus distance, meters; linear in between and held beyond.
    """

    distances: Float[Array, "K"]
    offsets: Float[Array, "K"]

    def __check_init__(self) -> None:
        if jnp.shape(self.distances) != jnp.shape(self.offsets) or jnp.ndim(self.distances) != 1:
            raise ValueError(
                f"distances have shape {jnp.shape(self.distances)} and offsets {jnp.shape(self.offsets)}: "
                "give one offset per distance"
            )

    def __call__(self, distances: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """Return the bias at true distances, meters."""
        return jnp.interp(distances, self.distances, self.offsets)


def lds_01_accuracy(distances: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """Return the LDS-01's accuracy: ±15 mm below 0.5 m, ±5 % beyond, made continuous (tighter) at 0.5 m."""
    return 0.015 + 0.05 * jnp.maximum(distances - _KINK, 0.0)


def draw_lds_01_bias(key: PRNGKeyArray, share: Scalar = 0.6) -> RangeBias:
    """Draw the bias of one LDS-01: a few waves over the distance, within the data sheet's accuracy.

    Errors of triangulation are smooth and grow with the distance; their shape differs from device to device.

    Args:
        key: PRNG key of the device.
        share: largest ratio of the bias to the accuracy, 0 to 1.
    """
    key_phase, key_weight = jax.random.split(key)
    # A knot at the kink of the accuracy: without it, the bias could exceed the accuracy between two knots.
    distances = jnp.sort(jnp.append(jnp.linspace(*_LIMITS, _NUM_KNOTS), _KINK))
    # From one wave over the whole range to one in 0.8 m.
    waves = 0.5 + jnp.arange(_NUM_WAVES, dtype=jnp.float32) * 1.25
    phases = jax.random.uniform(key_phase, (_NUM_WAVES,), jnp.float32, 0.0, 2.0 * jnp.pi)
    weights = jax.random.uniform(key_weight, (_NUM_WAVES,), jnp.float32, 0.5, 1.0) / (1.0 + waves)
    turns = jnp.outer((distances - _LIMITS[0]) / (_LIMITS[1] - _LIMITS[0]), 2.0 * jnp.pi * waves)
    shape = jnp.sin(turns + phases[None]) @ weights
    shape = shape / jnp.max(jnp.abs(shape))
    return RangeBias(distances, share * shape * lds_01_accuracy(distances))
