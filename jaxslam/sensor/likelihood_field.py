"""The likelihood-field model: how far each beam ended from the nearest obstacle."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxslam.core import se2
from jaxslam.core.types import LidarScan
from jaxslam.core.validation import require_at_least_zero
from jaxslam.grid.field import Field
from jaxslam.lidar.beams import scan_points
from jaxslam.sensor.base import AbstractSensorModel


class LikelihoodField(AbstractSensorModel):
    r"""Log-likelihood: $n_{ind}$ times the mean of $\log(z_{hit} e^{-d_k^2/2\sigma^2} + z_{rand})$.

    $d_k$ is measured across the wall that the beam's neighbours show, and straight where they show none. A
    beam that ends where the map knows nothing counts as the mean of the others: new ground speaks neither
    for a pose nor against it. The mean and not the sum, since neighbouring beams see the same wall and the
    error of a map is common to all: a scan says no more with more beams.

    Attributes:
        sigma_hit: spread of end points around obstacles, metres.
        z_hit: weight of the beams that saw the map.
        z_rand: weight of those that saw something else.
        z_unseen: density of a beam that is taken to end where the map knows nothing, as a share of the
            best, if no other beam tells.
        unseen_beams: how many beams of that density weigh in before the others decide.
        independent_beams: n_ind, how many independent beams a scan counts for.
        max_beams: beams that are scored, evenly spread over the scan (static).

    References:
        Thrun, Burgard, Fox, Probabilistic Robotics, table 6.3; the mean and what is new are ours.
    """

    sigma_hit: float | Float[Array, ""] = 0.1
    z_hit: float | Float[Array, ""] = 0.95
    z_rand: float | Float[Array, ""] = 0.05
    z_unseen: float | Float[Array, ""] = 0.5
    unseen_beams: float | Float[Array, ""] = 10.0
    independent_beams: float | Float[Array, ""] = 4.0
    max_beams: int = eqx.field(static=True, default=180)

    def __check_init__(self):
        require_at_least_zero(self, positive=("sigma_hit", "z_rand", "z_unseen"))

    def log_prob(self, field: Field, scan: LidarScan, pose: Float[Array, "3"]) -> Float[Array, ""]:
        """Scalar, natural log, at most 0: every beam on an obstacle, and `z_unseen` apart."""
        ends = scan_points(scan, self.max_beams)
        points, normals = se2.apply(pose, ends.points), se2.rotate_all(pose[2], ends.normals)
        _, unseen = field.fine.look_up(points)
        distance, across, _ = field.fine.across(points, normals)
        # Where the distance is cut off, so is the way to the obstacle.
        cut_off = distance > field.fine.radius - 0.5
        cells = jnp.where(cut_off, distance, across)
        squared = cells * cells * (field.fine.resolution * field.fine.resolution)
        density = self.z_hit * jnp.exp(-0.5 * squared / self.sigma_hit**2) + self.z_rand
        log_density = jnp.log(density / (self.z_hit + self.z_rand))
        seen = ends.valid & ~unseen
        total = jnp.sum(jnp.where(seen, log_density, 0.0)) + self.unseen_beams * jnp.log(self.z_unseen)
        count = jnp.maximum(jnp.sum(seen, dtype=jnp.float32) + self.unseen_beams, 1e-6)
        # A scan without a return says nothing.
        return jnp.where(jnp.any(ends.valid), self.independent_beams * total / count, 0.0)
