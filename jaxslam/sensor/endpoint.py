"""gmapping's end-point model: the nearest obstacle around each end point that the beam could reach."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxslam.core import se2
from jaxslam.core.types import LidarScan
from jaxslam.grid.field import DistanceField, Field
from jaxslam.lidar.beams import scan_points
from jaxslam.sensor.base import AbstractSensorModel

_BEFORE = float(np.sqrt(2.0))
"""Distance before the end point at which the beam must be free, cells: far enough to leave its cell."""


class Endpoint(AbstractSensorModel):
    r"""Log-likelihood $\beta \sum_k \max(-d_k^2 / 2\sigma^2, \text{log\_miss})$ over the valid beams.

    $d_k$ is the distance from the end point to the center of the nearest occupied cell among those at most
    `kernel` rows and columns away whose neighbor towards the lidar is not occupied. A wall is thus only
    matched from its front, which a distance field cannot distinguish from its back. Without such a cell the
    beam scores `log_miss`.

    gmapping measures the distance to the mean of the end points in a cell. A cell stores no mean here, so its
    center is used. gmapping's σ² is 2σ² here.

    Attributes:
        sigma_hit: σ, spread of end points around obstacles, meters.
        log_miss: log-likelihood of a beam without an obstacle, and the lower limit for all beams, nats, ≤ 0.
        beam_weight: β, weight of a beam relative to an independent one; beams are dependent because
            neighboring beams see the same wall and all beams share the error of the map.
        kernel: rows and columns searched on every side of the end point's cell, ≥ 0 (static).
        max_beams: number of beams that are scored, evenly spread over the scan (static).

    References:
        Grisetti, Stachniss, Burgard 2007 and the implementation published with it (likelihood-and-score).

    Example:
        With σ = 0.1 and 0.1 m cells, an end point 0.1 m from the center of the only obstacle, seen from its
        front, has −0.5 before weighting.
    """

    sigma_hit: float | Float[Array, ""] = 0.1
    log_miss: float | Float[Array, ""] = -2.0
    beam_weight: float | Float[Array, ""] = 0.03
    kernel: int = eqx.field(static=True, default=1)
    max_beams: int = eqx.field(static=True, default=180)

    def __check_init__(self):
        if self.kernel < 0:
            raise ValueError(f"Endpoint: kernel is {self.kernel} cells, must be >= 0")

    @property
    def independent_count(self) -> float | Float[Array, ""]:
        """Return `beam_weight` times the number of beams."""
        return self.beam_weight * self.max_beams

    def log_prob(self, prepared: Field, scan: LidarScan, pose: Float[Array, "3"]) -> Float[Array, ""]:
        """Return the natural log of the likelihood at a pose `[3]`, up to a constant; at most 0."""
        ends = scan_points(scan, self.max_beams)
        points = se2.apply(pose, ends.points)
        lidar = se2.compose(pose, scan.pose_base_lidar)[:2]
        squared = self._nearest_seen(prepared.fine, points, lidar)
        log_hit = jnp.maximum(-0.5 * squared / self.sigma_hit**2, self.log_miss)
        return self.beam_weight * jnp.sum(jnp.where(ends.valid, log_hit, 0.0))

    def _nearest_seen(
        self, field: DistanceField, points: Float[Array, "B 2"], lidar: Float[Array, "2"]
    ) -> Float[Array, "B"]:
        """Return the squared distance `[B]` in m² to the nearest obstacle the beam can see, or infinity."""
        ray = points - lidar[None, :]
        length = jnp.sqrt(jnp.sum(ray**2, axis=1))
        # A beam of zero length has no cell before its end; the limit only avoids a division by 0.
        back = ray * (_BEFORE * field.resolution / jnp.maximum(length, 1e-6))[:, None]
        cell, before = _cells(field, points), _cells(field, points - back)
        nearest = jnp.full(points.shape[0], jnp.inf, points.dtype)
        # One offset at a time, so that no array of beams × offsets is ever written.
        for row in range(-self.kernel, self.kernel + 1):
            for column in range(-self.kernel, self.kernel + 1):
                offset = jnp.asarray([[column, row]], jnp.int32)
                center = field.centers((cell + offset).astype(jnp.float32))
                in_front = field.centers((before + offset).astype(jnp.float32))
                seen = (field.squared_distance(center) == 0.0) & (field.squared_distance(in_front) != 0.0)
                squared = jnp.sum((points - center) ** 2, axis=1)
                nearest = jnp.where(seen, jnp.minimum(nearest, squared), nearest)
        return nearest


def _cells(field: DistanceField, points: Float[Array, "B 2"]) -> Int[Array, "B 2"]:
    return jnp.floor((points - field.origin[None, :]) / field.resolution).astype(jnp.int32)
