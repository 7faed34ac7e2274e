"""Scan matching by Gauss–Newton on the likelihood field."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxslam import se2
from jaxslam.lidar.beams import ScanPoints
from jaxslam.linalg import solve_symmetric
from jaxslam.sensor.field import DistanceField

DAMPING = 1e-3
"""Keeps the normal matrix invertible where neither field nor prior says anything."""


class PosePrior(eqx.Module):
    """A Gaussian over the pose: `mean` `[3]` (m, m, rad, world) and `precision` `[3, 3]`, its inverse covariance."""

    mean: Float[Array, "3"]
    precision: Float[Array, "3 3"]

    def log_prob(self, pose: Float[Array, "3"]) -> Float[Array, ""]:
        """Natural log up to a constant, 0 at the mean."""
        offset = _offset(self.mean, pose)
        return -0.5 * offset @ (self.precision @ offset)


class GaussNewton(eqx.Module):
    r"""Minimises $\sum_k (1 - M(x \oplus c_k))^2 / s^2$ plus the prior's quadratic, M = exp(−d²/2σ²) interpolated.

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

        def iterate(_: int, pose: Float[Array, "3"]) -> Float[Array, "3"]:
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
        arms = se2.rotate(jnp.broadcast_to(pose[2], ends.valid.shape), ends.points)
        points = arms + pose[None, :2]
        value, slope_x, slope_y = self._interpolate(field, points)
        weight = ends.valid.astype(jnp.float32)
        jacobian = jnp.stack([slope_x, slope_y, arms[:, 0] * slope_y - arms[:, 1] * slope_x])
        weighted = jacobian * weight[None]
        # One stacked reduction: six entries of the symmetric matrix and three of the right-hand side.
        terms = jnp.stack(
            [
                weighted[0] * jacobian[0],
                weighted[0] * jacobian[1],
                weighted[0] * jacobian[2],
                weighted[1] * jacobian[1],
                weighted[1] * jacobian[2],
                weighted[2] * jacobian[2],
                weighted[0] * (1.0 - value),
                weighted[1] * (1.0 - value),
                weighted[2] * (1.0 - value),
            ]
        )
        xx, xy, xt, yy, yt, tt, gx, gy, gt = jnp.sum(terms, axis=1) / self.residual_scale**2
        normal = jnp.stack([xx, xy, xt, xy, yy, yt, xt, yt, tt]).reshape(3, 3)
        return normal, jnp.stack([gx, gy, gt])

    def _interpolate(
        self, field: DistanceField, points: Float[Array, "B 2"]
    ) -> tuple[Float[Array, "B"], Float[Array, "B"], Float[Array, "B"]]:
        """M and its slopes per metre at the points, bilinear between cell centres."""
        cells = (points - field.origin[None]) / field.resolution - 0.5
        column = jnp.clip(cells[:, 0], 0.0, field.width - 1.01)
        row = jnp.clip(cells[:, 1], 0.0, field.height - 1.01)
        left, lower = column.astype(jnp.int32), row.astype(jnp.int32)
        across, up = column - left.astype(jnp.float32), row - lower.astype(jnp.float32)
        corner = lower * field.width + left
        corners = jnp.stack([corner, corner + 1, corner + field.width, corner + field.width + 1])
        squared = field.squared_cells.at[corners].get(mode="promise_in_bounds")
        value = jnp.exp(-0.5 * squared.astype(jnp.float32) / self.sigma_cells**2)
        slope_lower, slope_upper = value[1] - value[0], value[3] - value[2]
        on_lower, on_upper = value[0] + across * slope_lower, value[2] + across * slope_upper
        slope_x = slope_lower + up * (slope_upper - slope_lower)
        slope_y = on_upper - on_lower
        return on_lower + up * slope_y, slope_x / field.resolution, slope_y / field.resolution


def _offset(from_pose: Float[Array, "3"], to_pose: Float[Array, "3"]) -> Float[Array, "3"]:
    offset = to_pose - from_pose
    return offset.at[2].set(se2.wrap(offset[2]))
