"""What a proposal is."""

import abc

import equinox as eqx
import jax
from jaxtyping import Array, Float, Int, Key, PRNGKeyArray

from jaxslam.core.types import StepInputs
from jaxslam.grid.field import Field
from jaxslam.motion.base import AbstractMotionModel
from jaxslam.sensor.base import AbstractSensorModel


class Proposed(eqx.Module):
    """One particle's move.

    Attributes:
        pose: `[3]` the new base pose (m, m, rad, world frame).
        log_likelihood: log p(z | x, m) by the sensor model at that pose, which most proposals look at anyway.
        log_ratio: log p(x | x_prev, u) − log q(x), what the weight needs beside it.
        flags: `jaxslam.core.flags.Flag` bits, int32.
    """

    pose: Float[Array, "*N 3"]
    log_likelihood: Float[Array, "*N"]
    log_ratio: Float[Array, "*N"]
    flags: Int[Array, "*N"]


class AbstractProposal(eqx.Module):
    """q(x_t | x_{t−1}, u_t, z_t, m) for one particle."""

    @abc.abstractmethod
    def sample(
        self,
        key: PRNGKeyArray,
        pose: Float[Array, "3"],
        inputs: StepInputs,
        field: Field,
        motion: AbstractMotionModel,
        sensor: AbstractSensorModel,
    ) -> Proposed:
        """Draws the next pose. Vmap over particles with `in_axes=(0, 0, None, 0, None, None)`.

        Args:
            key: PRNG key.
            pose: `[3]` pose before the step.
            inputs: odometry since then and the scan.
            field: the particle's own map around it, prepared.
            motion: p(x | x_prev, u).
            sensor: p(z | x, m).
        """

    def sample_all(
        self,
        keys: Key[Array, "N"],
        poses: Float[Array, "N 3"],
        inputs: StepInputs,
        fields: Field,
        motion: AbstractMotionModel,
        sensor: AbstractSensorModel,
    ) -> Proposed:
        """Draws for all particles, leaves `[N, ...]`; for proposals whose particles know of each other."""
        each = jax.vmap(self.sample, (0, 0, None, 0, None, None))
        return each(keys, poses, inputs, fields, motion, sensor)
