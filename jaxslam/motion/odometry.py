"""The odometry motion model: rotate, drive, rotate."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxslam.core import se2
from jaxslam.core.types import OdometryIncrement, Scalar
from jaxslam.core.validation import require_at_least_zero
from jaxslam.motion._wheel_noise import ACROSS, ALONG, FINAL_ROTATION, TURN, AbstractWheelModel, NoiseModel


class OdometryMotion(AbstractWheelModel):
    r"""Odometry split into a rotation, a translation and a second rotation, each with its own noise.

    With $\delta_{rot1}, \delta_{trans}, \delta_{rot2}$ from the increment, the noise is normal with
    the **variances** of the second and later printings of Probabilistic Robotics:

    - rotations: $\alpha_1 \delta_{rot}^2 + \alpha_2 \delta_{trans}^2$;
    - translation: $\alpha_3 \delta_{trans}^2 + \alpha_4 (\delta_{rot1}^2 + \delta_{rot2}^2)$.

    The first printing is linear in the motion ($\alpha_1 |\delta_{rot1}| + \alpha_2
    \delta_{trans}$), and ROS 1 AMCL long used the variance as a standard deviation, so alphas of
    either source do not carry over.

    The model extends the book in three ways. For a robot that reverses, the translation is signed and
    the first rotation is at most a quarter turn, so that reversing does not cost two half turns. A
    translation below `direction_threshold` has no reliable direction and blends into a pure rotation.
    The floors keep a step without motion uncertain, and also apply across the path.

    Attributes:
        rotation_noise_from_rotation: α1, rad² per rad².
        rotation_noise_from_translation: α2, rad² per m².
        translation_noise_from_translation: α3, m² per m².
        translation_noise_from_rotation: α4, m² per rad².
        translation_floor: minimum standard deviation of the position per step and axis, m, > 0.
        rotation_floor: minimum standard deviation of the heading per step, rad, > 0.
        direction_threshold: translation at which its direction begins to count, m, > 0.

    References:
        Thrun, Burgard, Fox 2005, table 5.6 (`sample`) and 5.5 (`log_prob`, with the Jacobian and the
        noise of table 5.6).

    Example:
        1 m straight ahead with α1 = 0.02, α2 = 0.01, α3 = 0.01, α4 = 0.0025 and floors of 5 mm and
        5 mrad: deviations 0.1001 m along, 0.1002 m across and 0.1415 rad.
    """

    rotation_noise_from_rotation: Scalar = 0.09
    rotation_noise_from_translation: Scalar = 0.01
    translation_noise_from_translation: Scalar = 0.0025
    translation_noise_from_rotation: Scalar = 0.0025
    translation_floor: Scalar = 0.03
    rotation_floor: Scalar = 0.05
    direction_threshold: Scalar = 0.01

    def __check_init__(self):
        require_at_least_zero(self, positive=("translation_floor", "rotation_floor", "direction_threshold"))

    def noise_model(self, odometry: OdometryIncrement) -> NoiseModel:
        """Return the noise of the three parts of an increment (table 5.6)."""
        x, y, theta = odometry.delta
        forward = jnp.where(x < 0.0, -jnp.ones_like(x), jnp.ones_like(x))
        first_rotation = jnp.arctan2(
            forward * y, jnp.sqrt(x * x + self.direction_threshold * self.direction_threshold)
        )
        # `across` is what the direction threshold leaves.
        along, across = se2.rotate(-first_rotation, odometry.delta[:2])
        second_rotation = se2.wrap(theta - first_rotation)

        def noisy_increment(noise: Float[Array, "4"]) -> Float[Array, "3"]:
            direction = first_rotation + noise[TURN]
            translation = jnp.stack([along + noise[ALONG], across + noise[ACROSS]])
            heading = se2.wrap(direction + second_rotation + noise[FINAL_ROTATION])
            return jnp.append(se2.rotate(direction, translation), heading)

        first, second = first_rotation * first_rotation, second_rotation * second_rotation
        return noisy_increment, self._variances(first, second, along * along)

    def _variances(
        self, first: Float[Array, ""], second: Float[Array, ""], translation: Float[Array, ""]
    ) -> Float[Array, "4"]:
        """Return the variances of the noise from the squares of both rotations and of the translation."""
        translation_floor = self.translation_floor * self.translation_floor
        # The two rotations share the floor, so the heading's deviation is never below it.
        rotation = (
            self.rotation_noise_from_translation * translation
            + 0.5 * self.rotation_floor * self.rotation_floor
        )
        along = (
            self.translation_noise_from_translation * translation
            + self.translation_noise_from_rotation * (first + second)
            + translation_floor
        )
        return jnp.stack(
            [
                self.rotation_noise_from_rotation * first + rotation,
                along,
                jnp.full_like(along, translation_floor),
                self.rotation_noise_from_rotation * second + rotation,
            ]
        )
