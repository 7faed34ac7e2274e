"""The likelihood field as computed by nav2's AMCL: a sum of cubes."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxslam.core import se2
from jaxslam.core.types import LidarScan
from jaxslam.core.validation import require_at_least_zero
from jaxslam.grid.cell_table import CellTable
from jaxslam.grid.field import Field
from jaxslam.grid.known_map import KnownMap
from jaxslam.lidar.beams import end_points
from jaxslam.sensor.base import AbstractSensorModel


class Nav2Field(AbstractSensorModel):
    r"""Likelihood $1 + \sum_k p_k^3$ with $p_k = z_{hit} e^{-d_k^2/2\sigma^2} + z_{rand} / z_{max}$.

    nav2's AMCL and its predecessor in ROS 1 use this sum. It has no derivation and serves for comparison.

    Attributes:
        sigma_hit: standard deviation of end points around obstacles, meters.
        z_hit: weight of beams that hit a mapped obstacle.
        z_rand: weight of beams that hit something else.
        max_range: largest range of the lidar, meters.
        max_beams: number of beams that are scored, evenly spread over the scan (static).
    """

    sigma_hit: float | Float[Array, ""] = 0.2
    z_hit: float | Float[Array, ""] = 0.95
    z_rand: float | Float[Array, ""] = 0.05
    max_range: float | Float[Array, ""] = 80.0
    max_beams: int = eqx.field(static=True, default=60)

    def __check_init__(self):
        require_at_least_zero(self, positive=("sigma_hit", "z_rand", "max_range"))

    @property
    def independent_count(self) -> float:
        """Return 1: the sum of the cubes is not a product over beams."""
        return 1.0

    def prepare(self, map: KnownMap) -> CellTable:
        """Return the cube that a beam adds for each cell in which it can end."""
        return map.table(self._cube(map.hits(self.sigma_hit)))

    def log_prob(
        self, prepared: Field | CellTable, scan: LidarScan, pose: Float[Array, "3"]
    ) -> Float[Array, ""]:
        """Return the natural log of the sum at a pose `[3]`; 0 for a scan without a return."""
        if isinstance(prepared, CellTable):
            return self.log_prob_all(prepared, scan, pose[None])[0]
        points, valid = end_points(scan, self.max_beams)
        squared = prepared.fine.squared_distance(se2.apply(pose, points))
        cubes = self._cube(jnp.exp(-0.5 * squared / self.sigma_hit**2))
        return jnp.log1p(jnp.sum(jnp.where(valid, cubes, 0.0)))

    def log_prob_all(
        self, prepared: Field | CellTable, scan: LidarScan, poses: Float[Array, "N 3"]
    ) -> Float[Array, "N"]:
        """Return `log_prob` at each pose `[N, 3]`."""
        if isinstance(prepared, Field):
            return AbstractSensorModel.log_prob_all(self, prepared, scan, poses)
        points, valid = end_points(scan, self.max_beams)
        return jnp.log1p(prepared.sum_over_beams(poses, points, valid.astype(jnp.float32)))

    def _cube(self, hit: Float[Array, "*cells"]) -> Float[Array, "*cells"]:
        return (self.z_hit * hit + self.z_rand / self.max_range) ** 3
