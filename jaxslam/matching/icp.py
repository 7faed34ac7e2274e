"""Iterative closest points: against a particle's map, and of one scan against another."""

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
    """What an alignment ended with.

    Attributes:
        pose: `[3]` (m, m, rad), in the frame of the target.
        error: root mean square distance of the points kept from their partners, meters; infinite where
            there were none.
        covariance: `[3, 3]` of the pose: the residuals' variance times the inverse of what the walls seen
            say about it, so that it is long where they say little, as along a corridor.
        num_inliers: points kept at the end.
        converged: whether it stopped moving within the iterations.
    """

    pose: Float[Array, "3"]
    error: Float[Array, ""]
    covariance: Float[Array, "3 3"]
    num_inliers: Float[Array, ""]
    converged: Bool[Array, ""]


class ICP(eqx.Module):
    r"""Minimizes $E(R,T)=\frac1{n_C}\sum\|l_i-Rc_i-T\|^2$, tobacco (13)–(15).

    Partners $l_i$ of the points $c_i$: the nearest obstacle of the map, from the gradient of its distance
    field, first of the coarse one and then of the fine one. Pairs much farther apart than the others are
    trimmed.

    Attributes:
        trim: pairs farther apart than so many times the mean distance of all are left out.
        least_trim: but none nearer than this, meters.
        point_weight: what an end point without a wall counts for.
        half_range: range at which an end point counts half, meters.
        relaxation: factor on every step, under 2. The points on one wall hold back those on another, so a
            step of the plain algorithm, 1, goes only part of the way.
        tolerance: converged when a step is shorter than this, meters, and turns by less than as many
            radians.
        across_walls: partners on the map lie straight across the wall that a point's neighbors show, and not
            at the nearest obstacle, which at the end of what the map knows would draw the scan back (static).
        coarse_iterations: iterations on the coarse field (static); then
        num_iterations: on the fine one (static). A particle that has converged stays where it is.
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
        """Aligns a scan with a map, from the base pose `start` `[3]` in the world frame."""
        coarse = self._iterate(field.coarse, ends, start, self.coarse_iterations)[0]
        pose, converged = self._iterate(field.fine, ends, coarse, self.num_iterations)
        partners, distance, known = self._on_map(field.fine, ends, pose)
        return self._finish(ends, pose, converged, partners, distance, ends.valid & known)

    def match_scans(self, target: ScanPoints, ends: ScanPoints, start: Float[Array, "3"]) -> Alignment:
        """Aligns a scan with another one: the pose of its base in the other's, from a first guess `[3]`.

        Plain laser odometry. The nearest point of the other scan is found among all, B² distances.
        """

        def partners_of(pose: Float[Array, "3"]) -> tuple[Array, Array, Array]:
            points = se2.apply(pose, ends.points)
            apart = points[:, None, :] - target.points[None, :, :]
            squared = jnp.sum(apart * apart, axis=-1) + jnp.where(target.valid, 0.0, jnp.inf)[None, :]
            nearest = jnp.argmin(squared, axis=1)
            distance = jnp.sqrt(jnp.min(squared, axis=1))
            return target.points[nearest], distance, jnp.isfinite(distance)

        steps = self.coarse_iterations + self.num_iterations
        pose, converged = self._repeat(partners_of, ends, start, steps)
        partners, distance, known = partners_of(pose)
        return self._finish(ends, pose, converged, partners, distance, ends.valid & known)

    def _iterate(
        self, field: DistanceField, ends: ScanPoints, start: Float[Array, "3"], num_iterations: int
    ) -> tuple[Float[Array, "3"], Bool[Array, ""]]:
        return self._repeat(lambda pose: self._on_map(field, ends, pose), ends, start, num_iterations)

    def _repeat(
        self, partners_of, ends: ScanPoints, start: Float[Array, "3"], num_iterations: int
    ) -> tuple[Float[Array, "3"], Bool[Array, ""]]:
        def iterate(
            _: Int[Array, ""], carry: tuple[Float[Array, "3"], Bool[Array, ""]]
        ) -> tuple[Float[Array, "3"], Bool[Array, ""]]:
            pose, converged = carry
            partners, distance, known = partners_of(pose)
            inliers = self._inliers(distance, ends.valid & known)
            fitted = rigid_fit(ends.points, partners, inliers * self._worth(ends))
            enough = jnp.sum(inliers) >= 3
            step = se2.relative(pose, fitted)
            still = (jnp.hypot(step[0], step[1]) < self.tolerance) & (jnp.abs(step[2]) < self.tolerance)
            longer = se2.compose(pose, self.relaxation * step)
            moved = jnp.where(converged | ~enough, pose, longer)
            return moved, converged | (enough & still)

        return jax.lax.fori_loop(0, num_iterations, iterate, (start, jnp.zeros((), bool)))

    def _on_map(
        self, field: DistanceField, ends: ScanPoints, pose: Float[Array, "3"]
    ) -> tuple[Float[Array, "B 2"], Float[Array, "B"], Bool[Array, "B"]]:
        """Partner of each end point on the map, how far its nearest obstacle is (m), and if that is known."""
        points = se2.apply(pose, ends.points)
        normals = se2.rotate_all(pose[2], ends.normals) if self.across_walls else jnp.zeros_like(points)
        distance, across, direction = field.across(points, normals)
        # The bilinear slope is shorter than 1 at ridges and beside obstacles; the way to one is not.
        length = jnp.maximum(jnp.hypot(direction[:, 0], direction[:, 1]), _EMPTY)
        partners = points - direction * (across * field.resolution / length)[:, None]
        return partners, distance * field.resolution, distance < field.radius

    def _inliers(self, distance: Float[Array, "B"], usable: Bool[Array, "B"]) -> Float[Array, "B"]:
        """1 for the pairs that are kept, 0 for the others."""
        count, total = sums((usable.astype(jnp.float32), jnp.where(usable, distance, 0.0)))
        mean = total / jnp.maximum(count, 1.0)
        near = distance <= jnp.maximum(self.trim * mean, self.least_trim)
        return (usable & near).astype(jnp.float32)

    def _worth(self, ends: ScanPoints) -> Float[Array, "B"]:
        """What each end point counts for, by its range and whether its wall is known."""
        flat = (ends.normals[:, 0] != 0.0) | (ends.normals[:, 1] != 0.0)
        squared = jnp.sum(ends.points * ends.points, axis=1)
        return jnp.where(flat, 1.0, self.point_weight) / (1.0 + squared / self.half_range**2)

    def _finish(
        self,
        ends: ScanPoints,
        pose: Float[Array, "3"],
        converged: Bool[Array, ""],
        partners: Float[Array, "B 2"],
        distance: Float[Array, "B"],
        usable: Bool[Array, "B"],
    ) -> Alignment:
        weights = self._inliers(distance, usable)
        count = jnp.sum(weights)
        squared = jnp.sum(jnp.where(weights > 0, distance * distance, 0.0)) / jnp.maximum(count, 1.0)
        return Alignment(
            pose=pose,
            error=jnp.where(count > 0, jnp.sqrt(squared), jnp.inf),
            covariance=_covariance(ends, pose, weights, squared),
            num_inliers=count,
            converged=converged,
        )


def rigid_fit(
    points: Float[Array, "B 2"], partners: Float[Array, "B 2"], weights: Float[Array, "B"]
) -> Float[Array, "3"]:
    """The pose `[3]` that brings points nearest to their partners, in weighted least squares.

    In the plane the rotation U Vᵀ of the singular value decomposition has a closed form: the angle of the
    sums of dot and cross products about the centroids. With no weight at all the pose is the identity.

    Args:
        points: `[B, 2]` meters.
        partners: `[B, 2]` meters, in the frame that the pose is given in.
        weights: `[B]` ≥ 0.
    """
    # Far from the world's origin the products would lose their digits.
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
    # Where everything lies in one point, no angle is better than another.
    angle = jnp.where((cosine == 0.0) & (sine == 0.0), 0.0, jnp.arctan2(sine, cosine))
    place = target - se2.rotate_all(angle, center) + jnp.where(total > _EMPTY, origin, 0.0)
    return jnp.append(place, se2.wrap(angle))


def _covariance(
    ends: ScanPoints, pose: Float[Array, "3"], weights: Float[Array, "B"], variance: Float[Array, ""]
) -> Float[Array, "3 3"]:
    """Residual variance times the inverse information of the walls: only across them is a pose known."""
    rows = wall_jacobian(ends, pose[2])
    information = (rows * weights[None]) @ rows.T
    # A meter and a radian are as good as nothing known.
    floor = jnp.maximum(variance, 1e-6)
    return inverse_symmetric(information / floor + jnp.eye(3, dtype=jnp.float32))
