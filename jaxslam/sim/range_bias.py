"""What a cheap lidar is off by, distance by distance."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from jaxslam.sim.numeric import Scalar

_NUM_KNOTS = 71
_NUM_WAVES = 4
_KINK = 0.5
"""Where the LDS-01's accuracy begins to grow, meters."""


class RangeBias(eqx.Module):
    """A bias that depends on the distance, the same in every reading of one device.

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


def draw_lds_01_bias(
    key: PRNGKeyArray, share: Scalar = 0.6, shortest: float = 0.12, longest: float = 3.5
) -> RangeBias:
    """Draw the bias of one LDS-01: a few waves over the distance, within the data sheet's accuracy.

    Triangulation goes wrong smoothly, by an amount that grows with the distance; how is a matter of how
    the one device was put together.

    Args:
        key: of the device.
        share: of the accuracy that the bias reaches where it is worst, 0 to 1.
        shortest: distance that the lidar measures, meters.
        longest: and the farthest, meters.
    """
    key_phase, key_weight = jax.random.split(key)
    # With one where the accuracy has its kink: it would be exceeded between its neighbors.
    distances = jnp.sort(jnp.append(jnp.linspace(shortest, longest, _NUM_KNOTS), _KINK))
    # From one wave over the whole range to one in 0.8 m.
    waves = 0.5 + jnp.arange(_NUM_WAVES, dtype=jnp.float32) * 1.25
    phases = jax.random.uniform(key_phase, (_NUM_WAVES,), jnp.float32, 0.0, 2.0 * jnp.pi)
    weights = jax.random.uniform(key_weight, (_NUM_WAVES,), jnp.float32, 0.5, 1.0) / (1.0 + waves)
    turns = jnp.outer((distances - shortest) / (longest - shortest), 2.0 * jnp.pi * waves)
    shape = jnp.sin(turns + phases[None]) @ weights
    shape = shape / jnp.max(jnp.abs(shape))
    return RangeBias(distances, share * shape * lds_01_accuracy(distances))
