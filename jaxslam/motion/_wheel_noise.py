"""Common part of the wheel models: samples, densities and covariances from noise on an increment."""

import abc
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from jaxslam.core import se2
from jaxslam.core.linalg import LOG_TWO_PI
from jaxslam.core.types import OdometryIncrement
from jaxslam.motion.base import AbstractMotionModel

NoisyIncrement = Callable[[Float[Array, "4"]], Float[Array, "3"]]
NoiseModel = tuple[NoisyIncrement, Float[Array, "4"]]
"""An increment `[3]` (m, m, rad) as a function of the noise `[4]`, and the variances `[4]` of the noise."""

TURN, ALONG, ACROSS, FINAL_ROTATION = range(4)


class AbstractWheelModel(AbstractMotionModel):
    """Motion model of an increment with four independent, normal noise components.

    0. `TURN`: error of the rotation before (or during) the translation, rad;
    1. `ALONG`: error of the distance driven, m;
    2. `ACROSS`: slip perpendicular to the path, m;
    3. `FINAL_ROTATION`: error of the rotation that follows, rad.

    The heading error is turn + final rotation; the turn also bends the path.
    """

    @abc.abstractmethod
    def noise_model(self, odometry: OdometryIncrement) -> NoiseModel:
        """Return the noise of an increment."""

    def sample(
        self, key: PRNGKeyArray, pose: Float[Array, "3"], odometry: OdometryIncrement
    ) -> Float[Array, "3"]:
        """Draw the next pose `[3]`."""
        noisy_increment, variances = self.noise_model(odometry)
        standard = jax.random.normal(key, variances.shape, variances.dtype)
        return se2.compose(pose, noisy_increment(standard * jnp.sqrt(variances)))

    def log_prob(
        self, pose_next: Float[Array, "3"], pose: Float[Array, "3"], odometry: OdometryIncrement
    ) -> Float[Array, ""]:
        r"""Return the natural log of the density of `pose_next` per m²·rad; finite everywhere.

        Tables 5.1 and 5.5 of Thrun, Burgard, Fox 2005 give a density over the *noise*. As a density over
        poses it lacks the Jacobian, which grows without bound as the translation shrinks. This density is
        instead the product of two factors, and integrates to one:

        - heading error $h$: normal, exactly (for a deviation small against π);
        - position given $h$: normal, with mean and covariance to second order in the noise. The turn error
          is normal given $h$, with mean $k h$, $k = \sigma_t^2 / (\sigma_t^2 + \sigma_f^2)$, and variance
          $k \sigma_f^2$. The model is evaluated at this mean exactly, so the path bends with it.
        """
        noisy_increment, variances = self.noise_model(odometry)
        increment = se2.relative(pose, pose_next)
        turn_variance, final_variance = variances[TURN], variances[FINAL_ROTATION]
        heading_variance = turn_variance + final_variance
        share = turn_variance / heading_variance
        heading_error = se2.wrap(increment[2] - noisy_increment(jnp.zeros_like(variances))[2])

        expected = jnp.zeros_like(variances).at[TURN].set(share * heading_error)
        conditional_variances = variances.at[TURN].set(share * final_variance)[:FINAL_ROTATION]
        residual, covariance = _position_error(
            increment[:2], noisy_increment, expected, conditional_variances
        )
        return _normal_1d(heading_error, heading_variance) + _normal_2d(residual, covariance)

    def covariance(self, odometry: OdometryIncrement) -> Float[Array, "3 3"]:
        """Return the covariance `[3, 3]` of the increment in the predicted pose's frame (m², m·rad, rad²)."""
        noisy_increment, variances = self.noise_model(odometry)
        zero = jnp.zeros_like(variances)
        predicted = noisy_increment(zero)
        jacobian = jax.jacfwd(lambda noise: se2.relative(predicted, noisy_increment(noise)))(zero)
        covariance = (jacobian * variances[None, :]) @ jacobian.T
        return 0.5 * (covariance + covariance.T)


def _position_error(
    position: Float[Array, "2"],
    noisy_increment: NoisyIncrement,
    expected: Float[Array, "4"],
    variances: Float[Array, "3"],
) -> tuple[Float[Array, "2"], Float[Array, "2 2"]]:
    """Return the position minus its mean, and the covariance, in the frame of the path.

    The noise (turn, along, across) has mean `expected` and independent `variances`. With Jacobian J
    and Hessian H of the model: mean + ½ Σ H_ii σ_i², covariance J D Jᵀ + ½ Σ H_ij H_ijᵀ σ_i² σ_j².
    """

    def model(noise):
        return noisy_increment(expected.at[:FINAL_ROTATION].add(noise))[:2]

    zero = jnp.zeros_like(variances)
    jacobian = jax.jacfwd(model)(zero)
    hessian = jax.jacfwd(jax.jacfwd(model))(zero)
    # In the frame of the path the covariance is nearly diagonal, which avoids cancellation in float32.
    cos, sin = jacobian[:, ALONG] / jnp.linalg.norm(jacobian[:, ALONG])
    to_path = jnp.stack([jnp.stack([cos, sin]), jnp.stack([-sin, cos])])

    bend = 0.5 * jnp.einsum("kii,i->k", hessian, variances)
    deviations = jnp.sqrt(variances)
    first = to_path @ jacobian * deviations[None, :]
    second = jnp.einsum("kl,lij,i,j->kij", to_path, hessian, deviations, deviations)
    covariance = first @ first.T + 0.5 * jnp.einsum("kij,lij->kl", second, second)
    return to_path @ (position - model(zero) - bend), covariance


def _normal_1d(residual: Float[Array, ""], variance: Float[Array, ""]) -> Float[Array, ""]:
    return -0.5 * (residual * residual / variance + jnp.log(variance) + LOG_TWO_PI)


def _normal_2d(residual: Float[Array, "2"], covariance: Float[Array, "2 2"]) -> Float[Array, ""]:
    """Return the normal log-density by the 2 × 2 Cholesky factor: x, then y given x."""
    slope = covariance[0, 1] / covariance[0, 0]
    remaining = covariance[1, 1] - slope * covariance[0, 1]
    return _normal_1d(residual[0], covariance[0, 0]) + _normal_1d(
        residual[1] - slope * residual[0], remaining
    )
