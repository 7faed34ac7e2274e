"""Scan matching by Gauss–Newton on the likelihood field."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxslam import se2
from jaxslam.lidar.beams import ScanPoints
from jaxslam.linalg import solve_symmetric
from jaxslam.sensor.field import DistanceField

DAMPING = 1e-3
"""Keeps the normal matrix invertible where neither field nor prior says anything."""


class PosePrior(eqx.Module):
    """A Gaussian over the pose.

    Attributes:
        mean: `[3]` (m, m, rad, world frame).
        precision: `[3, 3]` its inverse covariance.
    """

    mean: Float[Array, "3"]
    precision: Float[Array, "3 3"]

    def log_prob(self, pose: Float[Array, "3"]) -> Float[Array, ""]:
        """Natural log up to a constant, 0 at the mean."""
        offset = _offset(self.mean, pose)
        return -0.5 * offset @ (self.precision @ offset)


class GaussNewton(eqx.Module):
    r"""Minimises $\sum_k (1 - M(x \oplus c_k))^2 / s^2$ plus the prior's quadratic.

    M = exp(−d²/2σ²) is interpolated between cells.

    Attributes:
        sigma_cells: σ, width of the basin, cells of the field it runs on.
        residual_scale: s, the residual that counts as much as one standard deviation of the prior.
        max_step_cells: a step is shortened to this many cells.
        max_step_rotation: and to this many radians.
        num_iterations: always this many (static).

    References:
        Kohlbrecher et al. 2011 (the residual), on the distance field instead of the occupancy.
    """

    sigma_cells: float | Float[Array, ""] = 2.0
    residual_scale: float | Float[Array, ""] = 0.45
    max_step_cells: float | Float[Array, ""] = 4.0
    max_step_rotation: float | Float[Array, ""] = 0.1
    num_iterations: int = eqx.field(static=True, default=8)

    def match(
        self, field: DistanceField, ends: ScanPoints, start: Float[Array, "3"], prior: PosePrior
    ) -> Float[Array, "3"]:
        """Pose `[3]` after the iterations from `start`; the caller compares scores."""

        def iterate(_: Int[Array, ""], pose: Float[Array, "3"]) -> Float[Array, "3"]:
            normal, gradient = self._linearise(field, ends, pose)
            normal = normal + prior.precision + DAMPING * jnp.eye(3, dtype=jnp.float32)
            gradient = gradient + prior.precision @ _offset(pose, prior.mean)
            step = solve_symmetric(normal, gradient)
            length = jnp.hypot(step[0], step[1]) / field.resolution
            shorten = jnp.maximum(length / self.max_step_cells, jnp.abs(step[2]) / self.max_step_rotation)
            return pose + step / jnp.maximum(shorten, 1.0)

        pose = jax.lax.fori_loop(0, self.num_iterations, iterate, start)
        return pose.at[2].set(se2.wrap(pose[2]))

    def _linearise(
        self, field: DistanceField, ends: ScanPoints, pose: Float[Array, "3"]
    ) -> tuple[Float[Array, "3 3"], Float[Array, "3"]]:
        """Normal matrix JᵀJ / s² and right-hand side Jᵀr / s²."""
        cos, sin = jnp.cos(pose[2]), jnp.sin(pose[2])
        arm_x = cos * ends.points[:, 0] - sin * ends.points[:, 1]
        arm_y = sin * ends.points[:, 0] + cos * ends.points[:, 1]
        value, slope_x, slope_y = self._interpolate(field, arm_x + pose[0], arm_y + pose[1])
        slope_theta = arm_x * slope_y - arm_y * slope_x
        residual = 1.0 - value
        weight = ends.valid.astype(jnp.float32) / self.residual_scale**2
        x, y, theta = slope_x * weight, slope_y * weight, slope_theta * weight
        # Nine sums and not one of a stack: fused with what they sum, they are four times as fast.
        xx, xy, xt = jnp.sum(x * slope_x), jnp.sum(x * slope_y), jnp.sum(x * slope_theta)
        yy, yt, tt = jnp.sum(y * slope_y), jnp.sum(y * slope_theta), jnp.sum(theta * slope_theta)
        gradient = jnp.stack([jnp.sum(x * residual), jnp.sum(y * residual), jnp.sum(theta * residual)])
        return jnp.stack([xx, xy, xt, xy, yy, yt, xt, yt, tt]).reshape(3, 3), gradient

    def _interpolate(
        self, field: DistanceField, x: Float[Array, "B"], y: Float[Array, "B"]
    ) -> tuple[Float[Array, "B"], Float[Array, "B"], Float[Array, "B"]]:
        """M and its slopes per metre at the points, bilinear between cell centres."""
        squared, along, up = field.corners(x, y)
        precision = -0.5 / self.sigma_cells**2
        lower_left, lower_right, upper_left, upper_right = (jnp.exp(precision * d) for d in squared)
        slope_lower, slope_upper = lower_right - lower_left, upper_right - upper_left
        lower, upper = lower_left + along * slope_lower, upper_left + along * slope_upper
        slope_x = slope_lower + up * (slope_upper - slope_lower)
        slope_y = upper - lower
        scale = 1.0 / field.resolution
        return lower + up * slope_y, slope_x * scale, slope_y * scale


def _offset(from_pose: Float[Array, "3"], to_pose: Float[Array, "3"]) -> Float[Array, "3"]:
    offset = to_pose - from_pose
    return offset.at[2].set(se2.wrap(offset[2]))
