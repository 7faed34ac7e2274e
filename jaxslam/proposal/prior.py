"""How much a proposal trusts the motion model as a prior of the pose."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxslam.core.linalg import inverse_symmetric
from jaxslam.core.types import OdometryIncrement
from jaxslam.core.validation import require_at_least_zero
from jaxslam.matching.gauss_newton import PosePrior
from jaxslam.motion.base import AbstractMotionModel


class PriorTrust(eqx.Module):
    """How much a match trusts the motion model.

    Attributes:
        translation: what its precision in position counts for, against that of the beams, which are not
            independent of each other either.
        rotation: and its precision in heading.
        least_translation: standard deviation in position that it is taken to have at least, meters: what the
            map itself is off by. Odometry that is better than this would never be corrected by a scan.
        least_rotation: and in heading, radians.
    """

    translation: float | Float[Array, ""] = 0.1
    rotation: float | Float[Array, ""] = 0.1
    least_translation: float | Float[Array, ""] = 0.02
    least_rotation: float | Float[Array, ""] = 0.01

    def __check_init__(self):
        require_at_least_zero(self)

    def around(
        self, motion: AbstractMotionModel, odometry: OdometryIncrement, drawn: Float[Array, "3"]
    ) -> PosePrior:
        """The prior about a draw `[3]` of the motion model, which each particle keeps its own of."""
        least = jnp.asarray([self.least_translation, self.least_translation, self.least_rotation])
        scale = jnp.sqrt(jnp.asarray([self.translation, self.translation, self.rotation]))
        covariance = motion.covariance(odometry)
        wider = jnp.maximum(least / jnp.sqrt(jnp.diagonal(covariance)), 1.0)
        precision = inverse_symmetric(covariance * wider[:, None] * wider[None, :])
        # Into the world's axes.
        cos, sin = jnp.cos(drawn[2]), jnp.sin(drawn[2])
        one, zero = jnp.ones_like(cos), jnp.zeros_like(cos)
        turn = jnp.stack([cos, -sin, zero, sin, cos, zero, zero, zero, one]).reshape(3, 3)
        return PosePrior(drawn, turn @ precision @ turn.T * scale[:, None] * scale[None, :])
