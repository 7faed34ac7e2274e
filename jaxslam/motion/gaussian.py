"""The motion model of an increment with a given covariance."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from jaxslam.core import se2
from jaxslam.core.linalg import LOG_TWO_PI, cholesky, rotation_matrix
from jaxslam.core.types import OdometryIncrement, Scalar
from jaxslam.core.validation import require_at_least_zero
from jaxslam.motion.base import AbstractMotionModel


class GaussianMotion(AbstractMotionModel):
    """Normally distributed increment with mean `odometry.delta` and covariance `odometry.covariance`.

    For odometry with its own covariance, such as the output of an EKF over wheels and IMU. The
    covariance is given in the axes of the base at the start, like `delta`. It is scaled, and squared
    floors are added to its diagonal, so that a covariance of zeros still spreads the particles.

    The covariance must be finite. If it is not positive semidefinite, it is replaced by one with the
    same variances, up to the floors, and admissible correlations.

    Attributes:
        covariance_scale: factor on the covariance of the increment, ≥ 0.
        translation_floor: standard deviation added to x and to y per step, m, > 0.
        rotation_floor: standard deviation added to the heading per step, rad, > 0.

    Example:
        With zero covariance and floors of 10 mm and 5 mrad, `covariance` is diag(1e-4, 1e-4, 2.5e-5) and
        `log_prob` at the predicted pose is 11.752.
    """

    covariance_scale: Scalar = 1.0
    translation_floor: Scalar = 0.005
    rotation_floor: Scalar = 0.005

    def __check_init__(self):
        require_at_least_zero(self, positive=("translation_floor", "rotation_floor"))

    def sample(
        self, key: PRNGKeyArray, pose: Float[Array, "3"], odometry: OdometryIncrement
    ) -> Float[Array, "3"]:
        """Draw the next pose `[3]` (m, m, rad)."""
        noise = self._factor(odometry) @ jax.random.normal(key, (3,), odometry.delta.dtype)
        return se2.compose(pose, odometry.delta + noise)

    def log_prob(
        self, pose_next: Float[Array, "3"], pose: Float[Array, "3"], odometry: OdometryIncrement
    ) -> Float[Array, ""]:
        """Return the natural log of the density of `pose_next` per m²·rad; the heading error is wrapped."""
        factor = self._factor(odometry)
        residual = se2.relative(pose, pose_next) - odometry.delta
        residual = residual.at[2].set(se2.wrap(residual[2]))
        whitened = jax.scipy.linalg.solve_triangular(factor, residual, lower=True)
        log_determinant = 2.0 * jnp.sum(jnp.log(jnp.diagonal(factor)))
        return -0.5 * (whitened @ whitened + log_determinant + 3.0 * LOG_TWO_PI)

    def covariance(self, odometry: OdometryIncrement) -> Float[Array, "3 3"]:
        """Return the covariance `[3, 3]` of the increment in the predicted pose's frame (m², m·rad, rad²)."""
        factor = rotation_matrix(odometry.delta[2]).T @ self._factor(odometry)
        return factor @ factor.T

    def _factor(self, odometry: OdometryIncrement) -> Float[Array, "3 3"]:
        floors = jnp.asarray(
            [self.translation_floor, self.translation_floor, self.rotation_floor], odometry.dt.dtype
        )
        variances = floors * floors
        covariance = 0.5 * self.covariance_scale * (odometry.covariance + odometry.covariance.T)
        return cholesky(covariance + jnp.diag(variances), variances)
