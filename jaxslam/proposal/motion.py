"""The traditional proposal: the motion model alone."""

import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from jaxslam.core.types import StepInputs
from jaxslam.grid.field import Field
from jaxslam.motion.base import AbstractMotionModel
from jaxslam.proposal.base import AbstractProposal, Proposed
from jaxslam.sensor.base import AbstractSensorModel


class MotionProposal(AbstractProposal):
    """q = p(x | x_prev, u): the weight is the observation likelihood (the baseline of all three papers)."""

    def sample(
        self,
        key: PRNGKeyArray,
        pose: Float[Array, "3"],
        inputs: StepInputs,
        field: Field,
        motion: AbstractMotionModel,
        sensor: AbstractSensorModel,
    ) -> Proposed:
        """Draws from the motion model, whatever the scan says."""
        moved = motion.sample(key, pose, inputs.odometry)
        return Proposed(
            pose=moved,
            log_likelihood=sensor.log_prob(field, inputs.scan, moved),
            log_ratio=jnp.zeros((), jnp.float32),
            flags=jnp.zeros((), jnp.int32),
        )
