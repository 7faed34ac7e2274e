"""The likelihood-field model: the distance of each beam's end from the nearest obstacle."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxslam.core import se2
from jaxslam.core.types import LidarScan
from jaxslam.core.validation import require_at_least_zero
from jaxslam.grid.cell_table import CellTable
from jaxslam.grid.field import Field
from jaxslam.grid.known_map import KnownMap
from jaxslam.lidar.beams import end_points, scan_points
from jaxslam.sensor.base import AbstractSensorModel


class LikelihoodField(AbstractSensorModel):
    r"""Log-likelihood: $n_{ind}$ times the mean of $\log(z_{hit} e^{-d_k^2/2\sigma^2} + z_{rand})$.

    The mean is used instead of the sum, because neighboring beams see the same wall and all beams share the
    error of the map: more beams do not make a scan more informative.

    On the map of a particle, $d_k$ is interpolated and measured across the wall given by the neighboring
    beams, or as the Euclidean distance where no wall is found. A beam that ends in unseen space scores the
    mean of the others: unseen space is evidence neither for a pose nor against it. On a known map, where many
    more particles are scored, $d_k$ is the distance stored in the cell in which the beam ends, and a scan
    with fewer than $n_{ind}$ beams counts as that number of beams.

    Attributes:
        sigma_hit: standard deviation of end points around obstacles, meters.
        z_hit: weight of beams that hit a mapped obstacle.
        z_rand: weight of beams that hit something else.
        z_unseen: density, relative to the best, of a scan whose beams all end in unseen space.
        unseen_beams: number of beams of density `z_unseen` that are added to the mean.
        independent_beams: n_ind, number of independent beams that a scan counts for. A larger value lets
            errors of the map decide between similar rooms before the robot has seen how they differ.
        max_beams: number of beams that are scored, evenly spread over the scan (static).

    References:
        Thrun, Burgard, Fox 2005, table 6.3; the mean and the treatment of unknown space are additions.

    Example:
        With the default weights on a known map, a beam that ends on an obstacle has density 1, one 2 σ away
        0.18, and one far from all obstacles 0.05.
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

    @property
    def independent_count(self) -> float | Float[Array, ""]:
        """Return `independent_beams`."""
        return self.independent_beams

    def prepare(self, map: KnownMap) -> CellTable:
        """Return the log density of a beam for each cell in which it can end."""
        return map.table(
            jnp.log((self.z_hit * map.hits(self.sigma_hit) + self.z_rand) / (self.z_hit + self.z_rand))
        )

    def log_prob(
        self, prepared: Field | CellTable, scan: LidarScan, pose: Float[Array, "3"]
    ) -> Float[Array, ""]:
        """Return the natural log of the likelihood at a pose `[3]`.

        Apart from the term of `z_unseen`, it is 0 if every beam ends on an obstacle, and lower otherwise.
        """
        if isinstance(prepared, CellTable):
            return self.log_prob_all(prepared, scan, pose[None])[0]
        fine = prepared.fine
        ends = scan_points(scan, self.max_beams)
        points, normals = se2.apply(pose, ends.points), se2.rotate(pose[2], ends.normals)
        _, unseen = fine.look_up(points)
        distance, across, _ = fine.across(points, normals)
        # Where the distance is truncated, the direction to the obstacle is unknown.
        truncated = distance > fine.radius - 0.5
        cells = jnp.where(truncated, distance, across)
        squared = cells * cells * (fine.resolution * fine.resolution)
        density = self.z_hit * jnp.exp(-0.5 * squared / self.sigma_hit**2) + self.z_rand
        log_density = jnp.log(density / (self.z_hit + self.z_rand))
        seen = ends.valid & ~unseen
        total = jnp.sum(jnp.where(seen, log_density, 0.0)) + self.unseen_beams * jnp.log(self.z_unseen)
        count = jnp.maximum(jnp.sum(seen, dtype=jnp.float32) + self.unseen_beams, 1e-6)
        # A scan without a return carries no information.
        return jnp.where(jnp.any(ends.valid), self.independent_beams * total / count, 0.0)

    def log_prob_all(
        self, prepared: Field | CellTable, scan: LidarScan, poses: Float[Array, "N 3"]
    ) -> Float[Array, "N"]:
        """Return `log_prob` at each pose `[N, 3]`; on a known map, all poses share the loop over beams."""
        if isinstance(prepared, Field):
            return AbstractSensorModel.log_prob_all(self, prepared, scan, poses)
        points, valid = end_points(scan, self.max_beams)
        weights = valid.astype(jnp.float32)
        total = prepared.sum_over_beams(poses, points, weights)
        return total * jnp.minimum(self.independent_beams / jnp.maximum(jnp.sum(weights), 1.0), 1.0)
