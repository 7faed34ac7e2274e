"""Scan matching by Gauss–Newton on the likelihood field."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxslam.core import se2
from jaxslam.core.linalg import solve_symmetric, sums
from jaxslam.core.validation import require_at_least_zero
from jaxslam.grid.field import DistanceField
from jaxslam.lidar.beams import ScanPoints

DAMPING = 1e-3
"""Keeps the normal matrix invertible where neither field nor prior constrains the pose."""


class PosePrior(eqx.Module):
    """A Gaussian over the pose.

    Attributes:
        mean: `[3]` (m, m, rad, world frame).
        precision: `[3, 3]` inverse covariance.
    """

    mean: Float[Array, "3"]
    precision: Float[Array, "3 3"]

    def log_prob(self, pose: Float[Array, "3"]) -> Float[Array, ""]:
        """Return the natural log of the density, up to the constant that makes it 0 at the mean."""
        offset = _offset(self.mean, pose)
        return -0.5 * offset @ (self.precision @ offset)


class GaussNewton(eqx.Module):
    r"""Gauss–Newton minimization of $\sum_k w_k e_k^2 / s^2$ plus the prior's quadratic.

    $e_k$ is the distance of an end point from the nearest obstacle, across the wall given by the neighboring
    end points (point to line), or the Euclidean distance where no wall is found. $w_k$ is exp(−d²/2σ²), times
    `point_weight` without a wall, divided by 1 + (range / `half_range`)².

    Attributes:
        sigma_cells: σ, width of the basin, in cells of the field used.
        residual_scale: s, distance that counts as one standard deviation of the prior, meters.
        point_weight: weight of an end point without a wall; its nearest obstacle is often beside it along a
            wall.
        half_range: range at which the weight of an end point is halved, meters.
        max_step_cells: limit on a step's translation, cells.
        max_step_rotation: limit on a step's rotation, radians.
        num_iterations: fixed number of iterations (static).

    References:
        Censi 2008 (point to line), with distances from the likelihood field; the weights are ours.
    """

    sigma_cells: float | Float[Array, ""] = 1.75
    residual_scale: float | Float[Array, ""] = 0.1
    point_weight: float | Float[Array, ""] = 0.2
    half_range: float | Float[Array, ""] = 8.0
    max_step_cells: float | Float[Array, ""] = 4.0
    max_step_rotation: float | Float[Array, ""] = 0.1
    num_iterations: int = eqx.field(static=True, default=14)

    def __check_init__(self):
        lengths = ("sigma_cells", "residual_scale", "half_range", "max_step_cells", "max_step_rotation")
        require_at_least_zero(self, positive=lengths)

    def match(
        self, field: DistanceField, ends: ScanPoints, start: Float[Array, "3"], prior: PosePrior
    ) -> Float[Array, "3"]:
        """Return the pose `[3]` after the iterations from `start`, whether or not its score is better."""

        def iterate(_: Int[Array, ""], pose: Float[Array, "3"]) -> Float[Array, "3"]:
            normal, gradient = self._linearize(field, ends, pose)
            normal = normal + prior.precision + DAMPING * jnp.eye(3, dtype=jnp.float32)
            gradient = gradient + prior.precision @ _offset(pose, prior.mean)
            step = solve_symmetric(normal, gradient)
            length = jnp.hypot(step[0], step[1]) / field.resolution
            shorten = jnp.maximum(length / self.max_step_cells, jnp.abs(step[2]) / self.max_step_rotation)
            return pose + step / jnp.maximum(shorten, 1.0)

        pose = jax.lax.fori_loop(0, self.num_iterations, iterate, start)
        return pose.at[2].set(se2.wrap(pose[2]))

    def _linearize(
        self, field: DistanceField, ends: ScanPoints, pose: Float[Array, "3"]
    ) -> tuple[Float[Array, "3 3"], Float[Array, "3"]]:
        """Return the normal matrix JᵀWJ / s² and the right-hand side −JᵀWe / s²."""
        arms, normals = se2.rotate(pose[2], ends.points), se2.rotate(pose[2], ends.normals)
        distance, across, direction = field.across(arms + pose[None, :2], normals)
        flat = (ends.normals[:, 0] != 0.0) | (ends.normals[:, 1] != 0.0)
        weight = jnp.exp(-0.5 * distance * distance / self.sigma_cells**2)
        weight = weight * jnp.where(flat, 1.0, self.point_weight)
        weight = weight / (1.0 + jnp.sum(ends.points * ends.points, axis=1) / self.half_range**2)
        # Where the distance is truncated, its true value is unknown.
        near = distance < field.radius
        weight = jnp.where(ends.valid & near, weight, 0.0) / self.residual_scale**2
        residual = -across * field.resolution
        slope_x, slope_y = direction[:, 0], direction[:, 1]
        slope_theta = arms[:, 0] * slope_y - arms[:, 1] * slope_x
        x, y, theta = slope_x * weight, slope_y * weight, slope_theta * weight
        terms = (x * slope_x, x * slope_y, x * slope_theta, y * slope_y, y * slope_theta, theta * slope_theta)
        products = (x * residual, y * residual, theta * residual)
        xx, xy, xt, yy, yt, tt, *gradient = sums((*terms, *products))
        return jnp.stack([xx, xy, xt, xy, yy, yt, xt, yt, tt]).reshape(3, 3), jnp.stack(gradient)


def _offset(from_pose: Float[Array, "3"], to_pose: Float[Array, "3"]) -> Float[Array, "3"]:
    offset = to_pose - from_pose
    return offset.at[2].set(se2.wrap(offset[2]))
