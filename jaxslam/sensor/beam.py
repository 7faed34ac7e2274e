"""The beam model: the measured range given the range that the map predicts."""

import equinox as eqx
import jax.numpy as jnp
from jax.scipy.special import ndtr
from jaxtyping import Array, Float

from jaxslam.core import se2
from jaxslam.core.types import LidarScan
from jaxslam.core.validation import require_at_least_zero
from jaxslam.grid.field import Field
from jaxslam.grid.raycast import cast
from jaxslam.lidar.beams import spread_beams
from jaxslam.sensor.base import AbstractSensorModel


class Beam(AbstractSensorModel):
    r"""Mixture density of the range $z$ of a beam, given the range $z^*$ cast in the map.

    - hit: normal around $z^*$ with deviation `sigma_hit`, normalized on [0, `max_range`];
    - short: $\propto e^{-\lambda_{short} z}$ on $[0, z^*]$, an unmapped obstacle in front of the mapped one;
    - max: a point mass at `max_range`, no return;
    - random: uniform on [0, `max_range`].

    The weights are divided by their sum, so that the density over [0, `max_range`) and the point mass at
    its end add up to one.

    Attributes:
        max_range: largest range of the lidar, meters: a reading at or over it is no return.
        sigma_hit: standard deviation of readings of the mapped obstacle, meters; at least half a cell.
        z_hit: weight of readings of the mapped obstacle.
        z_short: weight of readings of an obstacle in front of it.
        z_max: weight of no return.
        z_rand: weight of unexplained readings, > 0, so that one beam cannot rule out a pose.
        lambda_short: λ, rate at which unmapped obstacles become rarer with distance, 1/m, > 0.
        beam_weight: β, weight of a beam relative to an independent one; beams are dependent because
            neighboring beams see the same wall and all beams share the error of the map.
        max_beams: number of beams that are scored, evenly spread over the scan (static).

    References:
        Thrun, Burgard, Fox 2005, table 6.1; `beam_weight` is ours.

    Example:
        `Beam(10.0, sigma_hit=0.1, z_hit=0.8, z_short=0.05, z_max=0.05, z_rand=0.1, lambda_short=0.1)`: if the
        expected range is 2 m, the log density is 1.1707 at 2 m, −3.3535 at 1 m and −4.6052 at 5 m.
    """

    max_range: float | Float[Array, ""] = 80.0
    sigma_hit: float | Float[Array, ""] = 0.1
    z_hit: float | Float[Array, ""] = 0.75
    z_short: float | Float[Array, ""] = 0.1
    z_max: float | Float[Array, ""] = 0.05
    z_rand: float | Float[Array, ""] = 0.1
    lambda_short: float | Float[Array, ""] = 0.1
    beam_weight: float | Float[Array, ""] = 0.08
    max_beams: int = eqx.field(static=True, default=60)

    def __check_init__(self):
        require_at_least_zero(self, positive=("max_range", "sigma_hit", "z_rand", "lambda_short"))

    @property
    def independent_count(self) -> float | Float[Array, ""]:
        """Return `beam_weight` times the number of beams."""
        return self.beam_weight * self.max_beams

    def log_prob(self, prepared: Field, scan: LidarScan, pose: Float[Array, "3"]) -> Float[Array, ""]:
        """Return β times the sum of the beams' log densities per meter at a pose `[3]`.

        Beams without a return are left out: the mass at `max_range` is the same at every pose.
        """
        chosen = spread_beams(scan.num_beams, self.max_beams)
        ranges, valid = scan.ranges[chosen], scan.valid[chosen]
        pose_lidar = se2.compose(pose, scan.pose_base_lidar)
        entered = cast(prepared.fine, pose_lidar, scan.angles()[chosen], self.max_range)
        # The surface can be anywhere in the cell that it made occupied: on average, in the middle.
        expected = jnp.minimum(entered + 0.5 * prepared.fine.resolution, self.max_range)
        log_density = self.log_density(ranges, expected)
        returned = valid & (ranges < self.max_range)
        return self.beam_weight * jnp.sum(jnp.where(returned, log_density, 0.0))

    def log_density(self, ranges: Float[Array, "B"], expected: Float[Array, "B"]) -> Float[Array, "B"]:
        """Return the log density `[B]` per meter of ranges in [0, `max_range`), given expected ranges > 0."""
        weight = 1.0 / (self.z_hit + self.z_short + self.z_max + self.z_rand)
        density = (
            self.z_hit * self._hit(ranges, expected)
            + self.z_short * self._short(ranges, expected)
            + self.z_rand / self.max_range
        )
        return jnp.log(weight * density)

    def _hit(self, ranges: Float[Array, "B"], expected: Float[Array, "B"]) -> Float[Array, "B"]:
        residual = (ranges - expected) / self.sigma_hit
        normal = jnp.exp(-0.5 * residual**2) / (self.sigma_hit * jnp.sqrt(2 * jnp.pi))
        within = ndtr((self.max_range - expected) / self.sigma_hit) - ndtr(-expected / self.sigma_hit)
        return normal / within

    def _short(self, ranges: Float[Array, "B"], expected: Float[Array, "B"]) -> Float[Array, "B"]:
        density = self.lambda_short * jnp.exp(-self.lambda_short * ranges)
        within = -jnp.expm1(-self.lambda_short * expected)
        return jnp.where(ranges <= expected, density / within, 0.0)
