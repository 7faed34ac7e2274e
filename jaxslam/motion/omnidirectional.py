"""The motion model of a robot that drives in any direction without turning."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxslam.core import se2
from jaxslam.core.types import OdometryIncrement, Scalar
from jaxslam.core.validation import require_at_least_zero
from jaxslam.motion._wheel_noise import ACROSS, ALONG, FINAL_ROTATION, TURN, AbstractWheelModel, NoiseModel


class OmnidirectionalMotion(AbstractWheelModel):
    r"""Odometry as a straight translation in any direction and a simultaneous rotation, with normal noise.

    Unlike in `OdometryMotion`, the direction of the translation is independent of the heading: a robot
    that moves sideways has not turned. The noise is normal with the **variances**

    - along the path: $\alpha_3 \delta_{trans}^2 + \alpha_4 \delta_{rot}^2$;
    - across it: $\alpha_5 \delta_{trans}^2 + \alpha_4 \delta_{rot}^2$;
    - heading: $\alpha_1 \delta_{rot}^2 + \alpha_2 \delta_{trans}^2$.

    Attributes:
        rotation_noise_from_rotation: α1, rad² per rad².
        rotation_noise_from_translation: α2, rad² per m².
        translation_noise_from_translation: α3, m² per m².
        translation_noise_from_rotation: α4, m² per rad².
        strafe_noise_from_translation: α5, m² per m².
        translation_floor: minimum standard deviation of the position per step and axis, m, > 0.
        rotation_floor: minimum standard deviation of the heading per step, rad, > 0.

    References:
        Five noise parameters as in nav2's omnidirectional model; variances as in Thrun, Burgard, Fox 2005.

    Example:
        1 m to the left without turning, with the defaults: standard deviations of 0.0583 m along, 0.0583 m
        across and 0.1118 rad.
    """

    rotation_noise_from_rotation: Scalar = 0.09
    rotation_noise_from_translation: Scalar = 0.01
    translation_noise_from_translation: Scalar = 0.0025
    translation_noise_from_rotation: Scalar = 0.0025
    strafe_noise_from_translation: Scalar = 0.0025
    translation_floor: Scalar = 0.03
    rotation_floor: Scalar = 0.05

    def __check_init__(self):
        require_at_least_zero(self, positive=("translation_floor", "rotation_floor"))

    def noise_model(self, odometry: OdometryIncrement) -> NoiseModel:
        """Return the noise along the path of an increment, across it and in heading."""
        x, y, theta = odometry.delta
        squared = x * x + y * y
        moves = squared > 0.0
        length = jnp.where(moves, jnp.sqrt(jnp.where(moves, squared, 1.0)), 0.0)
        # A robot standing still has no direction of travel; any value works.
        direction = jnp.where(moves, jnp.arctan2(y, jnp.where(moves, x, 1.0)), 0.0)

        def noisy_increment(noise: Float[Array, "4"]) -> Float[Array, "3"]:
            translation = jnp.stack([length + noise[ALONG], noise[ACROSS]])
            # The turn exists for the interface shared by the wheel models; its variance is nearly zero.
            heading = se2.wrap(theta + noise[TURN] + noise[FINAL_ROTATION])
            return jnp.append(se2.rotate(direction + noise[TURN], translation), heading)

        return noisy_increment, self._variances(squared, theta * theta)

    def _variances(self, translation: Float[Array, ""], rotation: Float[Array, ""]) -> Float[Array, "4"]:
        """Return the variances of the noise from the squares of translation and rotation."""
        floor = self.translation_floor * self.translation_floor
        from_rotation = self.translation_noise_from_rotation * rotation + floor
        heading = (
            self.rotation_noise_from_rotation * rotation
            + self.rotation_noise_from_translation * translation
            + self.rotation_floor * self.rotation_floor
        )
        return jnp.stack(
            [
                # Not 0, where the square root has no finite derivative.
                jnp.full_like(heading, 1e-12),
                self.translation_noise_from_translation * translation + from_rotation,
                self.strafe_noise_from_translation * translation + from_rotation,
                heading,
            ]
        )
