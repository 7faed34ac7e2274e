"""A differential-drive robot that follows way-points round a closed tour: the true motion."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float64, Int

from jaxslam.core import se2
from jaxslam.sim.numeric import Scalar, compensated_add


class Robot(eqx.Module):
    """Limits and steering of the robot.

    The robot aims at a point `lookahead` ahead on the straight leg between two way-points. It slows down for
    the turn at the leg's end and for heading errors, and turns in place if necessary.

    Attributes:
        radius: radius of the circle around the robot, meters.
        max_speed: meters per second.
        max_acceleration: largest acceleration and deceleration, m/s².
        max_yaw_rate: rad/s.
        max_yaw_acceleration: rad/s².
        lookahead: distance of the aim point, meters.
        switch_distance: distance to a way-point at which the next leg begins, meters.
        steering_gain: yaw rate per heading error, 1/s.
        rate: steps of control and of physics per second (static).
    """

    radius: Scalar = 0.3
    max_speed: Scalar = 1.0
    max_acceleration: Scalar = 0.5
    max_yaw_rate: Scalar = 1.0
    max_yaw_acceleration: Scalar = 2.0
    lookahead: Scalar = 0.6
    switch_distance: Scalar = 0.25
    steering_gain: Scalar = 3.0
    rate: float = eqx.field(default=100.0, static=True)

    def __check_init__(self) -> None:
        if not self.rate > 0:
            raise ValueError(f"rate is {self.rate}: give the robot a positive number of steps per second")


class Drive(eqx.Module):
    """The true motion, at `rate` steps per second from time 0.

    Attributes:
        poses: `[P, 3]` base pose in the world frame: m, m, rad.
        velocities: `[P, 3]` base-frame velocity during the step that follows: m/s, m/s (0), rad/s.
        targets: `[P]` number of the current leg; it never decreases, and `targets[-1]` is the number of
            passed way-points.
        rate: steps per second (static).
    """

    poses: Float[Array, "*batch P 3"]
    velocities: Float[Array, "*batch P 3"]
    targets: Int[Array, "*batch P"]
    rate: float = eqx.field(static=True)

    def at(self, times: Float64[np.ndarray, "M"]) -> tuple[Float[Array, "M 3"], Float[Array, "M 3"]]:
        """Return exact true poses and base-frame velocities `[M, 3]` at any times in seconds.

        Times are host values, so that they keep float64; times outside the drive raise an error.
        """
        last = self.poses.shape[0] - 1
        if times.size and not (times.min() >= 0 and times.max() * self.rate <= last + 1e-6):
            raise ValueError(
                f"times from {times.min()} to {times.max()} s lie outside the drive of "
                f"{last / self.rate} s: simulate a longer duration"
            )
        # With the tolerance, a time that should lie on a step is not rounded down to the previous one.
        step = np.clip(np.floor(times * self.rate + 1e-6), 0, last).astype(int)
        remainder = jnp.asarray(np.maximum(times - step / self.rate, 0.0), jnp.float32)
        velocities = self.velocities[step]
        return jax.vmap(advance)(self.poses[step], velocities, remainder), velocities


class _State(eqx.Module):
    # The heading is not wrapped here, so that its sum can be compensated.
    pose: Float[Array, "3"]
    rounding: Float[Array, "3"]
    speed: Float[Array, ""]
    yaw_rate: Float[Array, ""]
    leg: Int[Array, ""]


def advance(pose: Float[Array, "3"], velocity: Float[Array, "3"], duration: Scalar) -> Float[Array, "3"]:
    """Move a pose at a constant base-frame velocity (vx, 0, ω) for `duration` s, along an exact arc.

    Example:
        From the origin at 1 m/s and π/2 rad/s for 1 s: (2/π, 2/π, π/2).
    """
    return _wrapped(pose + _displacement(pose[2], velocity, duration))


def _displacement(
    heading: Float[Array, ""], velocity: Float[Array, "3"], duration: Scalar
) -> Float[Array, "3"]:
    """Return the change of x, y and heading made by `advance`, in the world frame."""
    half_turn = velocity[2] * duration / 2
    # Chord of the arc: the length driven times sin(h)/h; jnp.sinc(x) is sin(πx)/(πx).
    chord = velocity[0] * duration * jnp.sinc(half_turn / jnp.pi)
    direction = heading + half_turn
    return jnp.stack([chord * jnp.cos(direction), chord * jnp.sin(direction), 2 * half_turn])


def _wrapped(pose: Float[Array, "3"]) -> Float[Array, "3"]:
    return pose.at[2].set(se2.wrap(pose[2]))


def follow_tour(robot: Robot, waypoints: Float[Array, "W 2"], num_steps: int) -> Drive:
    """Drive repeatedly round a closed tour, from rest at the first way-point, facing the second.

    Args:
        robot: limits and steering.
        waypoints: `[W, 2]` meters, world frame; the first follows the last.
        num_steps: steps to simulate, `robot.rate` per second (static).

    Returns:
        The drive with `P = num_steps + 1` poses, the first one at rest.
    """
    heading = jnp.arctan2(*(waypoints[1] - waypoints[0])[::-1])
    start = jnp.concatenate([waypoints[0], heading[None]])
    zero = jnp.zeros((), jnp.float32)
    initial = _State(start, jnp.zeros(3, jnp.float32), zero, zero, jnp.zeros((), jnp.int32))

    def step(state: _State, _: None) -> tuple[_State, tuple[Array, Array, Array]]:
        speed, yaw_rate, leg = _command(robot, waypoints, state)
        velocity = jnp.stack([speed, zero, yaw_rate])
        step_made = _displacement(state.pose[2], velocity, 1 / robot.rate)
        pose, rounding = compensated_add(state.pose, state.rounding, step_made)
        return _State(pose, rounding, speed, yaw_rate, leg), (_wrapped(state.pose), velocity, leg)

    _, (poses, velocities, targets) = jax.lax.scan(step, initial, None, length=num_steps + 1)
    return Drive(poses=poses, velocities=velocities, targets=targets, rate=robot.rate)


def _command(
    robot: Robot, waypoints: Float[Array, "W 2"], state: _State
) -> tuple[Float[Array, ""], Float[Array, ""], Int[Array, ""]]:
    """Return speed and yaw rate of the next step, within the limits, and the leg to follow."""
    remaining = _project(waypoints, state.leg, state.pose)[1]
    leg = state.leg + (remaining <= robot.switch_distance).astype(jnp.int32)
    along, remaining = _project(waypoints, leg, state.pose)
    goal = waypoints[(leg + 1) % waypoints.shape[0]]
    turn = jnp.abs(se2.wrap(_bearing(waypoints, leg + 1) - _bearing(waypoints, leg)))

    aim = goal - along * jnp.maximum(remaining - robot.lookahead, 0.0)
    error = se2.wrap(jnp.arctan2(*(aim - state.pose[:2])[::-1]) - state.pose[2])

    corner_speed = robot.max_speed * jnp.clip(1.0 - turn / (jnp.pi / 2), 0.2, 1.0)
    to_corner = jnp.maximum(remaining - robot.switch_distance, 0.0)
    braking = jnp.sqrt(corner_speed**2 + 2 * robot.max_acceleration * to_corner)
    # Full speed without heading error; beyond one radian the robot turns in place.
    speed = jnp.minimum(robot.max_speed * jnp.clip(1.0 - jnp.abs(error), 0.0, 1.0), braking)
    # The second bound is the largest yaw rate that can be braked before the robot faces the aim.
    yaw_rate = jnp.sign(error) * jnp.minimum(
        jnp.minimum(robot.steering_gain * jnp.abs(error), robot.max_yaw_rate),
        jnp.sqrt(robot.max_yaw_acceleration * jnp.abs(error)),
    )
    return (
        _limit(state.speed, speed, robot.max_acceleration / robot.rate),
        _limit(state.yaw_rate, yaw_rate, robot.max_yaw_acceleration / robot.rate),
        leg,
    )


def _project(
    waypoints: Float[Array, "W 2"], leg: Int[Array, ""], pose: Float[Array, "3"]
) -> tuple[Float[Array, "2"], Float[Array, ""]]:
    """Return the direction of a leg and the distance left along it, meters."""
    bearing = _bearing(waypoints, leg)
    along = jnp.stack([jnp.cos(bearing), jnp.sin(bearing)])
    goal = waypoints[(leg + 1) % waypoints.shape[0]]
    return along, jnp.sum((goal - pose[:2]) * along)


def _bearing(waypoints: Float[Array, "W 2"], leg: Int[Array, ""]) -> Float[Array, ""]:
    """Return the direction of the leg that starts at way-point `leg`, radians, world frame."""
    count = waypoints.shape[0]
    difference = waypoints[(leg + 1) % count] - waypoints[leg % count]
    return jnp.arctan2(difference[1], difference[0])


def _limit(value: Float[Array, ""], wanted: Float[Array, ""], change: Scalar) -> Float[Array, ""]:
    return jnp.clip(wanted, value - change, value + change)
