"""The velocity motion model: an arc, then a small rotation in place."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxslam.core import se2
from jaxslam.core.types import OdometryIncrement, Scalar
from jaxslam.core.validation import require_at_least_zero
from jaxslam.motion._wheel_noise import ACROSS, ALONG, FINAL_ROTATION, TURN, AbstractWheelModel, NoiseModel


class VelocityMotion(AbstractWheelModel):
    r"""Constant speed and turn rate over a step, each with noise, and a final rotation.

    The noise of $v$, $\omega$ and the final rotation $\gamma$ is normal with the **variances** of
    the book: $\alpha_1 v^2 + \alpha_2 \omega^2$ for $v$, $\alpha_3 v^2 + \alpha_4 \omega^2$ for
    $\omega$, $\alpha_5 v^2 + \alpha_6 \omega^2$ for $\gamma$. Since $v$, $\omega$ and their noise
    are constant over a step, its duration cancels: the model works on the arc's length $v\,dt$ and
    angle $\omega\,dt$. It does not read `dt`, so `dt = 0` or a broken stamp does no harm.

    The chord of the arc lies along the mean heading, as wheels drive it. Any measured motion across the
    chord (none for a differential drive) is kept unchanged, so that the mean of the model is always the
    increment itself. The floors keep a step without motion uncertain.

    Attributes:
        translation_noise_from_translation: α1, m² per m².
        translation_noise_from_rotation: α2, m² per rad².
        rotation_noise_from_translation: α3, rad² per m².
        rotation_noise_from_rotation: α4, rad² per rad².
        final_rotation_noise_from_translation: α5, rad² per m².
        final_rotation_noise_from_rotation: α6, rad² per rad².
        translation_floor: minimum standard deviation of the position per step and axis, m, > 0.
        rotation_floor: minimum standard deviation of the heading per step, rad, > 0.

    References:
        Thrun, Burgard, Fox 2005, table 5.3 (`sample`) and 5.1 (`log_prob`, with the Jacobian and the
        noise of table 5.3).

    Example:
        1 m straight ahead with α1 = 0.01, α3 = 0.01, α5 = 0.005 and floors of 5 mm and 5 mrad:
        deviations 0.1001 m along, 0.0503 m across (the arc's chord turns by half its angle) and
        0.1226 rad.
    """

    translation_noise_from_translation: Scalar = 0.01
    translation_noise_from_rotation: Scalar = 0.0025
    rotation_noise_from_translation: Scalar = 0.01
    rotation_noise_from_rotation: Scalar = 0.01
    final_rotation_noise_from_translation: Scalar = 0.005
    final_rotation_noise_from_rotation: Scalar = 0.005
    translation_floor: Scalar = 0.005
    rotation_floor: Scalar = 0.005

    def __check_init__(self):
        require_at_least_zero(self, positive=("translation_floor", "rotation_floor"))

    def noise_model(self, odometry: OdometryIncrement) -> NoiseModel:
        """Return the noise of the arc of an increment (table 5.3)."""
        # With the angle wrapped, half of it stays within a quarter turn, where the chord is never zero.
        angle = se2.wrap(odometry.delta[2])
        chord, across = se2.rotate(-0.5 * angle, odometry.delta[:2])
        length = chord / _chord_per_arc(angle)

        def noisy_increment(noise: Float[Array, "4"]) -> Float[Array, "3"]:
            noisy_angle = angle + noise[TURN]
            noisy_chord = (length + noise[ALONG]) * _chord_per_arc(noisy_angle)
            translation = jnp.stack([noisy_chord, across + noise[ACROSS]])
            heading = se2.wrap(noisy_angle + noise[FINAL_ROTATION])
            return jnp.append(se2.rotate(0.5 * noisy_angle, translation), heading)

        return noisy_increment, self._variances(length * length, angle * angle)

    def _variances(self, translation: Float[Array, ""], rotation: Float[Array, ""]) -> Float[Array, "4"]:
        """Return the variances of the noise from the squares of the arc's length and angle."""
        translation_floor = self.translation_floor * self.translation_floor
        # The arc and the final rotation share the floor, so the heading's deviation is never below it.
        rotation_floor = 0.5 * self.rotation_floor * self.rotation_floor
        along = (
            self.translation_noise_from_translation * translation
            + self.translation_noise_from_rotation * rotation
            + translation_floor
        )
        turn = (
            self.rotation_noise_from_translation * translation
            + self.rotation_noise_from_rotation * rotation
            + rotation_floor
        )
        final_rotation = (
            self.final_rotation_noise_from_translation * translation
            + self.final_rotation_noise_from_rotation * rotation
            + rotation_floor
        )
        return jnp.stack([turn, along, jnp.full_like(along, translation_floor), final_rotation])


def _chord_per_arc(angle: Float[Array, ""]) -> Float[Array, ""]:
    """Return sin(a/2) / (a/2), the ratio of the chord to the length of an arc of angle a.

    The ratio is 1 for a straight line. Equation (5.9) divides by ω; this form needs no special case for a
    straight line. `jnp.sinc` has the same values, but its second derivative near 0 is float32 rounding noise.
    """
    half = 0.5 * angle
    square = half * half
    # Up to (a/2)⁶; the next term is 1e-8 at the switch.
    series = 1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0))
    is_small = jnp.abs(half) < 0.5
    divisor = jnp.where(is_small, jnp.ones_like(half), half)
    return jnp.where(is_small, series, jnp.sin(divisor) / divisor)
