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
    residual_scale: float | Float[Array, ""] = 0.1
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
        """Normal matrix JᵀWJ / s² and right-hand side −JᵀWe / s²."""
        cos, sin = jnp.cos(pose[2]), jnp.sin(pose[2])
        arm_x = cos * ends.points[:, 0] - sin * ends.points[:, 1]
        arm_y = sin * ends.points[:, 0] + cos * ends.points[:, 1]
        distance, slope_x, slope_y = field.interpolate(arm_x + pose[0], arm_y + pose[1])
        flat = (ends.normals[:, 0] != 0.0) | (ends.normals[:, 1] != 0.0)
        normal_x = jnp.where(flat, cos * ends.normals[:, 0] - sin * ends.normals[:, 1], slope_x)
        normal_y = jnp.where(flat, sin * ends.normals[:, 0] + cos * ends.normals[:, 1], slope_y)
        along_normal = jnp.where(flat, normal_x * slope_x + normal_y * slope_y, 1.0)
        residual = -distance * along_normal * field.resolution
        kernel = jnp.exp(-0.5 * distance * distance / self.sigma_cells**2)
        weight = jnp.where(ends.valid, kernel, 0.0) / self.residual_scale**2
        normal_theta = arm_x * normal_y - arm_y * normal_x
        x, y, theta = normal_x * weight, normal_y * weight, normal_theta * weight
        # Nine sums and not one of a stack: fused with what they sum, they are four times as fast.
        xx, xy, xt = jnp.sum(x * normal_x), jnp.sum(x * normal_y), jnp.sum(x * normal_theta)
        yy, yt, tt = jnp.sum(y * normal_y), jnp.sum(y * normal_theta), jnp.sum(theta * normal_theta)
        gradient = jnp.stack([jnp.sum(x * residual), jnp.sum(y * residual), jnp.sum(theta * residual)])
        return jnp.stack([xx, xy, xt, xy, yy, yt, xt, yt, tt]).reshape(3, 3), gradient


def _offset(from_pose: Float[Array, "3"], to_pose: Float[Array, "3"]) -> Float[Array, "3"]:
    offset = to_pose - from_pose
    return offset.at[2].set(se2.wrap(offset[2]))
