"""Kalman filter of wheel odometry and IMU, Liang et al. (7)–(11)."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxslam.core import se2
from jaxslam.core.linalg import rotation_matrix
from jaxslam.core.types import Scalar
from jaxslam.core.validation import require_at_least_zero, require_one_of

STATE_SIZE = 6
"""X, Y (m), θ (rad), and their rates v_x, v_y (m/s) and ω (rad/s)."""
HEADING = 2

# 99.9 % quantiles of the χ² distribution by degrees of freedom, 0 to 6.
_GATES = (jnp.inf, 10.828, 13.816, 16.266, 18.467, 20.515, 22.458)


class Belief(eqx.Module):
    """A Gaussian over the state and, optionally, a copy of an earlier pose: `S` = 6, or 6 + 3 with a copy.

    Attributes:
        mean: `[S]`; headings in [−π, π).
        covariance: `[S, S]`, symmetric and positive.
    """

    mean: Float[Array, "S"]
    covariance: Float[Array, "S S"]


class Measurement(eqx.Module):
    """A reading of some components of the state; stacked over time, `[M, 6]`, in a stream.

    Attributes:
        value: `[6]`; components that are not `seen` are ignored.
        variance: `[6]` variance of each component.
        seen: `[6]` which components were measured.
    """

    value: Float[Array, "*M 6"]
    variance: Float[Array, "*M 6"]
    seen: Bool[Array, "*M 6"]

    @property
    def any_seen(self) -> Bool[Array, "*M"]:
        """Return whether any component was measured."""
        return jnp.any(self.seen, axis=-1)


class EKFUpdate(eqx.Module):
    """A belief after a reading.

    Attributes:
        belief: the updated belief; the old one if the reading was rejected.
        distance: squared Mahalanobis distance of the reading.
        accepted: whether the reading passed the gate.
    """

    belief: Belief
    distance: Float[Array, ""]
    accepted: Bool[Array, ""]


class EKF(eqx.Module):
    r"""Constant-velocity model with white acceleration noise.

    With `frame="world"` the rates are those of X and Y, and $x_{t+1} = x_t + [\Delta t\,I_3; 0](v_x, v_y,
    \omega)^T$ (Liang et al. 8) is linear. With `frame="body"` they are along and across the robot. The
    rotation by the heading then makes the filter an extended Kalman filter, and v_y, which is zero for wheels
    without slip, can be kept small.

    Attributes:
        acceleration: spectral density of the acceleration along x, m/s² per √Hz.
        lateral_acceleration: spectral density along y in the body frame, where wheels allow hardly any.
        angular_acceleration: spectral density of the angular acceleration, rad/s² per √Hz.
        gate: whether readings beyond the 99.9 % quantile of χ² are rejected (static).
        frame: frame of the rates, "body" or "world" (static).
    """

    acceleration: Scalar = 0.5
    lateral_acceleration: Scalar = 0.1
    angular_acceleration: Scalar = 0.5
    gate: bool = eqx.field(static=True, default=True)
    frame: str = eqx.field(static=True, default="body")

    def __check_init__(self):
        require_at_least_zero(self)
        require_one_of(self, "frame", ("body", "world"))

    def predict(self, belief: Belief, dt: Float[Array, ""]) -> Belief:
        """Return the belief `dt` ≥ 0 seconds later."""
        mean, transition = self._transition(belief.mean, dt)
        noise = self._process_noise(belief.mean, dt)
        return Belief(_wrapped(mean), _symmetric(transition @ belief.covariance @ transition.T + noise))

    def update(self, belief: Belief, measurement: Measurement) -> EKFUpdate:
        """Return the belief after a reading, with the covariance in Joseph's form."""
        size = belief.mean.shape[0]
        seen = measurement.seen
        innovation = measurement.value - belief.mean[:STATE_SIZE]
        innovation = innovation.at[HEADING].set(se2.wrap(innovation[HEADING]))
        innovation = jnp.where(seen, innovation, 0.0)
        # A component that was not measured has a zero row in H and variance 1 in R, and thus no effect.
        observe = jnp.where(seen[:, None], jnp.eye(STATE_SIZE, size, dtype=belief.mean.dtype), 0.0)
        noise = jnp.diag(jnp.where(seen, measurement.variance, 1.0))
        spread = observe @ belief.covariance @ observe.T + noise
        gain = jnp.linalg.solve(spread, observe @ belief.covariance).T
        distance = innovation @ jnp.linalg.solve(spread, innovation)
        remain = jnp.eye(size, dtype=belief.mean.dtype) - gain @ observe
        covariance = remain @ belief.covariance @ remain.T + gain @ noise @ gain.T
        limit = jnp.asarray(_GATES, belief.mean.dtype)[jnp.sum(seen, dtype=jnp.int32)]
        accepted: Bool[Array, ""] = jnp.isfinite(distance) & ((distance <= limit) if self.gate else True)
        mean = jnp.where(accepted, belief.mean + gain @ innovation, belief.mean)
        kept = jnp.where(accepted, _symmetric(covariance), belief.covariance)
        return EKFUpdate(Belief(_wrapped(mean), kept), distance, accepted)

    def _transition(
        self, mean: Float[Array, "S"], dt: Float[Array, ""]
    ) -> tuple[Float[Array, "S"], Float[Array, "S S"]]:
        """Return the state after `dt`, Liang et al. (8), and its Jacobian."""
        jacobian = jnp.eye(mean.shape[0], dtype=mean.dtype)
        if self.frame == "world":
            moved = mean.at[:3].add(dt * mean[3:6])
            return moved, jacobian.at[jnp.arange(3), jnp.arange(3, 6)].set(dt)
        # The heading halfway through the turn makes the result nearly independent of the step length.
        heading = mean[HEADING] + 0.5 * dt * mean[5]
        velocity = se2.rotate(heading, mean[3:5])
        moved = mean.at[:2].add(dt * velocity).at[HEADING].add(dt * mean[5])
        by_heading = dt * jnp.stack([-velocity[1], velocity[0]])
        jacobian = jacobian.at[:3, 3:6].set(dt * rotation_matrix(heading))
        return moved, jacobian.at[:2, HEADING].set(by_heading).at[:2, 5].set(0.5 * dt * by_heading)

    def _process_noise(self, mean: Float[Array, "S"], dt: Float[Array, ""]) -> Float[Array, "S S"]:
        """Return the noise of white accelerations over `dt`: dt³/3, dt²/2 and dt times their densities."""
        # World axes are not aligned with the robot, so both get the larger density.
        lateral = self.acceleration if self.frame == "world" else self.lateral_acceleration
        densities = (self.acceleration, lateral, self.angular_acceleration)
        turn = jnp.eye(3, dtype=mean.dtype) if self.frame == "world" else rotation_matrix(mean[HEADING])
        rates = jnp.diag(jnp.stack([jnp.asarray(density, mean.dtype) ** 2 for density in densities]))
        noise = jnp.zeros((mean.shape[0],) * 2, mean.dtype)
        noise = noise.at[:3, :3].set(turn @ rates @ turn.T * dt**3 / 3)
        noise = noise.at[:3, 3:6].set(turn @ rates * dt**2 / 2)
        noise = noise.at[3:6, :3].set(rates @ turn.T * dt**2 / 2)
        return noise.at[3:6, 3:6].set(rates * dt)


def with_copy(belief: Belief) -> Belief:
    """Append a copy of the pose, `[6 + 3]`, relative to which later motion is measured."""
    take = jnp.arange(STATE_SIZE + 3).at[STATE_SIZE:].set(jnp.arange(3))
    return Belief(belief.mean[take], belief.covariance[take][:, take])


def since_copy(belief: Belief) -> tuple[Float[Array, "3"], Float[Array, "3 3"]]:
    """Return the current pose in the frame of the copied pose, and its covariance to first order."""
    copied, now = belief.mean[STATE_SIZE : STATE_SIZE + 3], belief.mean[:3]
    relative = se2.relative(copied, now)
    by_now = rotation_matrix(copied[HEADING]).T
    by_copy = (-by_now).at[0, HEADING].set(relative[1]).at[1, HEADING].set(-relative[0])
    jacobian = jnp.concatenate([by_now, jnp.zeros_like(by_now), by_copy], axis=1)
    return relative, _symmetric(jacobian @ belief.covariance @ jacobian.T)


def _wrapped(mean: Float[Array, "S"]) -> Float[Array, "S"]:
    """Wrap the heading of the state, and that of the copied pose if there is one."""
    for heading in range(HEADING, mean.shape[0], STATE_SIZE):
        mean = mean.at[heading].set(se2.wrap(mean[heading]))
    return mean


def _symmetric(matrix: Float[Array, "n n"]) -> Float[Array, "n n"]:
    return 0.5 * (matrix + matrix.T)
