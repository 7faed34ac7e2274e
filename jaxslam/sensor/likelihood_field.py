"""The likelihood-field model: how far each beam ended from the nearest obstacle."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxslam import se2
from jaxslam.lidar.beams import scan_points
from jaxslam.sensor.base import AbstractSensorModel
from jaxslam.sensor.field import Field
from jaxslam.types import LidarScan


class LikelihoodField(AbstractSensorModel):
    r"""Log-likelihood $\beta \sum_k \log(z_{hit} e^{-d_k^2 / 2\sigma^2} + z_{rand})$ over the valid beams.

    Attributes:
        sigma_hit: spread of end points around obstacles, metres.
        z_hit: weight of the beams that saw the map.
        z_rand: weight of those that saw something else.
        z_unseen: density of a beam that ends where the map knows nothing yet, as a share of the best: at
            the average of a beam on a good match, new ground speaks neither for a pose nor against it.
        beam_weight: β, what one beam counts for against independent ones: neighbouring beams see the
            same wall, and the error of a map is common to them.
        max_beams: beams that are scored, evenly spread over the scan (static).

    References:
        Thrun, Burgard, Fox, Probabilistic Robotics, table 6.3; `beam_weight` is ours.
    """

    sigma_hit: float | Float[Array, ""] = 0.1
    z_hit: float | Float[Array, ""] = 0.95
    z_rand: float | Float[Array, ""] = 0.05
    z_unseen: float | Float[Array, ""] = 0.5
    beam_weight: float | Float[Array, ""] = 0.05
    num_neutral: float | Float[Array, ""] = 10.0
    max_beams: int = eqx.field(static=True, default=180)

    def log_prob(self, field: Field, scan: LidarScan, pose: Float[Array, "3"]) -> Float[Array, ""]:
        """Scalar, natural log; 0 is the best there is (every beam on an obstacle)."""
        ends = scan_points(scan, self.max_beams)
        points = se2.apply(pose, ends.points)
        _, unseen = field.fine.look_up(points)
        distance, slope_x, slope_y = field.fine.interpolate(points[:, 0], points[:, 1])
        cos, sin = jnp.cos(pose[2]), jnp.sin(pose[2])
        normal_x = cos * ends.normals[:, 0] - sin * ends.normals[:, 1]
        normal_y = sin * ends.normals[:, 0] + cos * ends.normals[:, 1]
        flat = (ends.normals[:, 0] != 0.0) | (ends.normals[:, 1] != 0.0)
        far = distance > field.fine.radius - 0.5
        across = jnp.where(flat & ~far, normal_x * slope_x + normal_y * slope_y, 1.0)
        squared = (distance * across * field.fine.resolution)**2
        density = self.z_hit * jnp.exp(-0.5 * squared / self.sigma_hit**2) + self.z_rand
        density = density / (self.z_hit + self.z_rand)
        seen = ends.valid & ~unseen
        total = jnp.sum(jnp.where(seen, jnp.log(density), 0.0))
        num = jnp.sum(ends.valid, dtype=jnp.float32)
        shrink = self.num_neutral
        total = (total + shrink * jnp.log(self.z_unseen)) * num / (jnp.sum(seen, dtype=jnp.float32) + shrink)
        return self.beam_weight * total
