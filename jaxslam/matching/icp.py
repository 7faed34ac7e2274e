"""Iterative closest points: a scan against a particle's map."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxslam.core import se2
from jaxslam.core.linalg import inverse_symmetric, sums
from jaxslam.core.validation import require_at_least_zero
from jaxslam.grid.field import DistanceField, Field
from jaxslam.lidar.beams import ScanPoints, wall_jacobian

_EMPTY = 1e-6


class Alignment(eqx.Module):
    """The result of an alignment.

    Attributes:
        pose: `[3]` (m, m, rad, world frame).
        error: root mean square distance of the inliers from their partners, meters; infinite without
            inliers.
        covariance: `[3, 3]` of the pose: the residuals' variance times the inverse information of the walls
            seen, so it is large in directions that no wall constrains, as along a corridor.
        num_inliers: number of inliers at the end.
        converged: whether it converged within the iterations.
    """

    pose: Float[Array, "3"]
    error: Float[Array, ""]
    covariance: Float[Array, "3 3"]
    num_inliers: Float[Array, ""]
    converged: Bool[Array, ""]


class ICP(eqx.Module):
    r"""Minimization of $E(R,T)=\frac1{n_C}\sum\|l_i-Rc_i-T\|^2$, Liang et al. (13)–(15).

    The partner $l_i$ of a point $c_i$ is the nearest obstacle of the map, found with the gradient of the
    distance field, first the coarse one and then the fine one. Pairs much farther apart than the average are
    trimmed.

    Attributes:
        trim: pairs farther apart than this multiple of the mean distance are trimmed.
        least_trim: pairs nearer than this are never trimmed, meters.
        point_weight: weight of an end point without a wall.
        half_range: range at which the weight of an end point is halved, meters.
        relaxation: factor on every step, under 2. In the plain algorithm (factor 1), points on one wall hold
            back points on another, so that a step covers only part of the distance.
        tolerance: a step counts as converged if it moves less than this, meters, and turns less than this,
            radians.
        across_walls: take partners straight across the wall given by a point's neighbors instead of at the
            nearest obstacle, which would pull the scan back at the end of the mapped area (static).
        coarse_iterations: iterations on the coarse field (static).
        num_iterations: iterations on the fine field (static). A particle that has converged stops moving.
    """

    trim: float | Float[Array, ""] = 2.5
    least_trim: float | Float[Array, ""] = 0.1
    point_weight: float | Float[Array, ""] = 0.2
    half_range: float | Float[Array, ""] = 8.0
    relaxation: float | Float[Array, ""] = 1.9
    tolerance: float | Float[Array, ""] = 1e-4
    across_walls: bool = eqx.field(static=True, default=True)
    coarse_iterations: int = eqx.field(static=True, default=6)
    num_iterations: int = eqx.field(static=True, default=14)

    def __check_init__(self):
        require_at_least_zero(self, positive=("trim", "half_range", "relaxation"))

    def match(self, field: Field, ends: ScanPoints, start: Float[Array, "3"]) -> Alignment:
        """Align a scan with a map, from the base pose `start` `[3]` in the world frame."""
        pose, _ = self._iterate(field.coarse, ends, start, self.coarse_iterations)
        pose, converged = self._iterate(field.fine, ends, pose, self.num_iterations)
        _, distance, inliers = self._partners(field.fine, ends, pose)
        count = jnp.sum(inliers)
        variance = jnp.sum(jnp.where(inliers > 0, distance * distance, 0.0)) / jnp.maximum(count, 1.0)
        rows = wall_jacobian(ends, pose[2])
        information = (rows * inliers[None]) @ rows.T / jnp.maximum(variance, 1e-6)
        return Alignment(
            pose=pose,
            error=jnp.where(count > 0, jnp.sqrt(variance), jnp.inf),
            # A weak prior of 1 m and 1 rad keeps the matrix invertible.
            covariance=inverse_symmetric(information + jnp.eye(3, dtype=jnp.float32)),
            num_inliers=count,
            converged=converged,
        )

    def _iterate(
        self, field: DistanceField, ends: ScanPoints, start: Float[Array, "3"], num_iterations: int
    ) -> tuple[Float[Array, "3"], Bool[Array, ""]]:
        def iterate(
            _: Int[Array, ""], carry: tuple[Float[Array, "3"], Bool[Array, ""]]
        ) -> tuple[Float[Array, "3"], Bool[Array, ""]]:
            pose, converged = carry
            partners, _, inliers = self._partners(field, ends, pose)
            fitted = rigid_fit(ends.points, partners, inliers * self._worth(ends))
            enough = jnp.sum(inliers) >= 3
            step = se2.relative(pose, fitted)
            still = (jnp.hypot(step[0], step[1]) < self.tolerance) & (jnp.abs(step[2]) < self.tolerance)
            longer = se2.compose(pose, self.relaxation * step)
            moved = jnp.where(converged | ~enough, pose, longer)
            return moved, converged | (enough & still)

        return jax.lax.fori_loop(0, num_iterations, iterate, (start, jnp.zeros((), bool)))

    def _partners(
        self, field: DistanceField, ends: ScanPoints, pose: Float[Array, "3"]
    ) -> tuple[Float[Array, "B 2"], Float[Array, "B"], Float[Array, "B"]]:
        """Return each end point's partner, its obstacle distance (m), and 1 for inliers, 0 otherwise."""
        points = se2.apply(pose, ends.points)
        normals = se2.rotate(pose[2], ends.normals) if self.across_walls else jnp.zeros_like(points)
        cells, across, direction = field.across(points, normals)
        # The bilinear slope is shorter than 1 at ridges and beside obstacles, so it is normalized.
        length = jnp.maximum(jnp.hypot(direction[:, 0], direction[:, 1]), _EMPTY)
        partners = points - direction * (across * field.resolution / length)[:, None]
        # Where the distance is truncated, the partner is unknown.
        usable, distance = ends.valid & (cells < field.radius), cells * field.resolution
        count, total = sums((usable.astype(jnp.float32), jnp.where(usable, distance, 0.0)))
        mean = total / jnp.maximum(count, 1.0)
        near = distance <= jnp.maximum(self.trim * mean, self.least_trim)
        return partners, distance, (usable & near).astype(jnp.float32)

    def _worth(self, ends: ScanPoints) -> Float[Array, "B"]:
        """Return the weight of each end point, from its range and whether its wall is known."""
        flat = (ends.normals[:, 0] != 0.0) | (ends.normals[:, 1] != 0.0)
        squared = jnp.sum(ends.points * ends.points, axis=1)
        return jnp.where(flat, 1.0, self.point_weight) / (1.0 + squared / self.half_range**2)


def rigid_fit(
    points: Float[Array, "B 2"], partners: Float[Array, "B 2"], weights: Float[Array, "B"]
) -> Float[Array, "3"]:
    """Return the pose `[3]` that moves points onto their partners with the least weighted squared error.

    In the plane the rotation U Vᵀ of the singular value decomposition has a closed form: the angle of the
    sums of dot and cross products about the centroids. If all weights are zero, the pose is the identity.

    Args:
        points: `[B, 2]` meters.
        partners: `[B, 2]` meters, in the frame of the returned pose.
        weights: `[B]` ≥ 0.
    """
    # Relative to a partner: far from the world's origin the products would lose precision.
    origin = partners[0]
    from_x, from_y = points[:, 0], points[:, 1]
    to_x, to_y = partners[:, 0] - origin[0], partners[:, 1] - origin[1]
    weighted_x, weighted_y = weights * from_x, weights * from_y
    total, sum_from_x, sum_from_y, sum_to_x, sum_to_y, dot, cross = sums(
        (
            weights,
            weighted_x,
            weighted_y,
            weights * to_x,
            weights * to_y,
            weighted_x * to_x + weighted_y * to_y,
            weighted_x * to_y - weighted_y * to_x,
        )
    )
    total = jnp.maximum(total, _EMPTY)
    center = jnp.stack([sum_from_x, sum_from_y]) / total
    target = jnp.stack([sum_to_x, sum_to_y]) / total
    cosine = dot - total * (center[0] * target[0] + center[1] * target[1])
    sine = cross - total * (center[0] * target[1] - center[1] * target[0])
    # If all points coincide, every angle fits equally well.
    angle = jnp.where((cosine == 0.0) & (sine == 0.0), 0.0, jnp.arctan2(sine, cosine))
    place = target - se2.rotate(angle, center) + jnp.where(total > _EMPTY, origin, 0.0)
    return jnp.append(place, se2.wrap(angle))
