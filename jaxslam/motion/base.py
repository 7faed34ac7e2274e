"""The contract of a motion model."""

import abc

import equinox as eqx
from jaxtyping import Array, Float, PRNGKeyArray

from jaxslam.core.types import OdometryIncrement


class AbstractMotionModel(eqx.Module):
    """Motion model p(x_t | x_{t−1}, u_t) of one particle; vmap over particles with `in_axes=(0, 0, None)`."""

    @abc.abstractmethod
    def sample(
        self, key: PRNGKeyArray, pose: Float[Array, "3"], odometry: OdometryIncrement
    ) -> Float[Array, "3"]:
        """Draw the next pose `[3]` (m, m, rad, world frame) from the last pose and the odometry."""

    @abc.abstractmethod
    def log_prob(
        self, pose_next: Float[Array, "3"], pose: Float[Array, "3"], odometry: OdometryIncrement
    ) -> Float[Array, ""]:
        """Return the natural log of the density of `pose_next` given `pose` and the odometry."""

    @abc.abstractmethod
    def covariance(self, odometry: OdometryIncrement) -> Float[Array, "3 3"]:
        """Return the covariance `[3, 3]` of the increment in the *predicted* pose's frame (m², m·rad, rad²).

        Symmetric positive definite, to first order in the noise. Scan matchers use it as their prior.
        """
