"""The contract of a proposal."""

import abc
import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
from jaxtyping import Array, Float, Int, Key, PRNGKeyArray

from jaxslam.core.types import LidarScan, OdometryIncrement
from jaxslam.grid.field import Field
from jaxslam.motion.base import AbstractMotionModel
from jaxslam.sensor.base import AbstractSensorModel


class ProposalContext(eqx.Module):
    """The inputs of a proposal at one step, except the pose.

    Attributes:
        odometry: u_t, the motion since the last step.
        scan: z_t.
        field: distance field of the particle's own map around its predicted pose.
        motion: p(x_t | x_{t−1}, u_t).
        sensor: p(z_t | x_t, m).
    """

    odometry: OdometryIncrement
    scan: LidarScan
    field: Field
    motion: AbstractMotionModel
    sensor: AbstractSensorModel

    def for_each(self, function: Callable, *arguments: Any) -> Any:
        """Return `function(*arguments, context)` for all particles, whose contexts differ only in the field.

        The leaves of the arguments, of `field` and of the result are `[N, ...]`.
        """

        def call(field: Field, *arguments: Any) -> Any:
            return function(*arguments, dataclasses.replace(self, field=field))

        return jax.vmap(call)(self.field, *arguments)

    def log_likelihood(self, pose: Float[Array, "3"]) -> Float[Array, ""]:
        """Return log p(z | x, m) at a pose `[3]` (m, m, rad, world frame)."""
        return self.sensor.log_prob(self.field, self.scan, pose)


class ProposalResult(eqx.Module):
    """The move of one particle.

    Attributes:
        pose: `[3]` the new base pose (m, m, rad, world frame).
        log_likelihood: log p(z | x, m) of the sensor model at that pose; most proposals compute it anyway.
        log_ratio: log p(x | x_prev, u) − log q(x), the other term of the weight.
        flags: `jaxslam.core.flags.Flag` bits, int32.
    """

    pose: Float[Array, "*N 3"]
    log_likelihood: Float[Array, "*N"]
    log_ratio: Float[Array, "*N"]
    flags: Int[Array, "*N"]


class AbstractProposal(eqx.Module):
    """q(x_t | x_{t−1}, u_t, z_t, m) for one particle."""

    @abc.abstractmethod
    def sample(self, key: PRNGKeyArray, pose: Float[Array, "3"], context: ProposalContext) -> ProposalResult:
        """Draw the next pose of one particle.

        Args:
            key: PRNG key.
            pose: `[3]` pose before the step (m, m, rad, world frame).
            context: odometry, scan, the particle's map, motion model and sensor model.
        """

    def sample_all(
        self, keys: Key[Array, "N"], poses: Float[Array, "N 3"], context: ProposalContext
    ) -> ProposalResult:
        """Draw for all particles; the leaves of the result are `[N, ...]`.

        The context has the fields of all particles, leaves `[N, ...]`. Override this method in a proposal
        whose particles depend on each other.
        """
        return context.for_each(self.sample, keys, poses)
