"""The motion model as a prior of the pose, and how much a proposal trusts it."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxslam.core.linalg import inverse_symmetric, rotation_matrix
from jaxslam.core.types import OdometryIncrement, Scalar
from jaxslam.core.validation import require_at_least_zero
from jaxslam.matching.gauss_newton import PosePrior
from jaxslam.motion.base import AbstractMotionModel


class PriorTrust(eqx.Module):
    """Trust of a match in the motion model.

    Attributes:
        translation: weight of the motion prior's positional precision relative to the scan (0 ignores the
            prior, 1 trusts it fully). Beams are not independent, so their precision is overstated too.
        rotation: weight of the prior's precision in heading.
        least_translation: lower limit of the prior's standard deviation in position, meters: the error of the
            map itself. Without it, a scan would never correct odometry that is more precise than this.
        least_rotation: lower limit of the prior's standard deviation in heading, radians.
    """

    translation: Scalar = 0.1
    rotation: Scalar = 0.1
    least_translation: Scalar = 0.02
    least_rotation: Scalar = 0.01

    def __check_init__(self):
        require_at_least_zero(self)

    def around(
        self, motion: AbstractMotionModel, odometry: OdometryIncrement, drawn: Float[Array, "3"]
    ) -> PosePrior:
        """Return the prior centered on a particle's own draw `[3]` of the motion model."""
        least = jnp.asarray([self.least_translation, self.least_translation, self.least_rotation])
        scale = jnp.sqrt(jnp.asarray([self.translation, self.translation, self.rotation]))
        covariance = motion.covariance(odometry)
        wider = jnp.maximum(least / jnp.sqrt(jnp.diagonal(covariance)), 1.0)
        precision = inverse_symmetric(covariance * wider[:, None] * wider[None, :])
        # Rotate into the world's axes.
        turn = rotation_matrix(drawn[2])
        return PosePrior(drawn, turn @ precision @ turn.T * scale[:, None] * scale[None, :])
