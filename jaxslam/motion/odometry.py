"""The odometry motion model: rotate, drive, rotate."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from jaxslam.core import se2
from jaxslam.core.types import OdometryIncrement
from jaxslam.core.validation import require_at_least_zero
from jaxslam.motion._wheel_noise import (
    ACROSS,
    ALONG,
    FINAL_ROTATION,
    TURN,
    Scalar,
    increment_log_prob,
    predicted_frame_covariance,
    sample_increment,
)
from jaxslam.motion.base import AbstractMotionModel


class OdometryMotion(AbstractMotionModel):
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
        noise of table 5.6, see `increment_log_prob`).

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

    def sample(
        self, key: PRNGKeyArray, pose: Float[Array, "3"], odometry: OdometryIncrement
    ) -> Float[Array, "3"]:
        """Draw the next pose `[3]` (table 5.6)."""
        parts = self._decompose(odometry)
        increment = sample_increment(key, parts.noisy_increment, self._variances(parts))
        return se2.compose(pose, increment)

    def log_prob(
        self, pose_next: Float[Array, "3"], pose: Float[Array, "3"], odometry: OdometryIncrement
    ) -> Float[Array, ""]:
        """Return the natural log of the density of `pose_next` per m²·rad; finite everywhere."""
        parts = self._decompose(odometry)
        increment = se2.relative(pose, pose_next)
        return increment_log_prob(increment, parts.noisy_increment, self._variances(parts))

    def covariance(self, odometry: OdometryIncrement) -> Float[Array, "3 3"]:
        """Return the covariance `[3, 3]` of the increment in the predicted pose's frame (m², m·rad, rad²)."""
        parts = self._decompose(odometry)
        return predicted_frame_covariance(parts.noisy_increment, self._variances(parts))

    def _decompose(self, odometry: OdometryIncrement) -> "_RotateDriveRotate":
        x, y, theta = odometry.delta
        forward = jnp.where(x < 0.0, -jnp.ones_like(x), jnp.ones_like(x))
        first_rotation = jnp.arctan2(
            forward * y, jnp.sqrt(x * x + self.direction_threshold * self.direction_threshold)
        )
        along, across = se2.rotate(-first_rotation, odometry.delta[:2])
        return _RotateDriveRotate(first_rotation, along, across, se2.wrap(theta - first_rotation))

    def _variances(self, parts: "_RotateDriveRotate") -> Float[Array, "4"]:
        first = parts.first_rotation * parts.first_rotation
        second = parts.second_rotation * parts.second_rotation
        translation = parts.along * parts.along
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


class _RotateDriveRotate(eqx.Module):
    """An increment, decomposed exactly; `across` is the rest left by the direction threshold, m."""

    first_rotation: Float[Array, ""]
    along: Float[Array, ""]
    across: Float[Array, ""]
    second_rotation: Float[Array, ""]

    def noisy_increment(self, noise: Float[Array, "4"]) -> Float[Array, "3"]:
        """Return the increment `[3]` with noise `[4]` (turn, along, across, final rotation) added."""
        direction = self.first_rotation + noise[TURN]
        translation = jnp.stack([self.along + noise[ALONG], self.across + noise[ACROSS]])
        heading = se2.wrap(direction + self.second_rotation + noise[FINAL_ROTATION])
        return jnp.append(se2.rotate(direction, translation), heading)
