"""The interface of a sensor model."""

import abc
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxslam.core.types import LidarScan
from jaxslam.grid.known_map import KnownMap
from jaxslam.lidar.beams import spread_beams


class AbstractSensorModel(eqx.Module):
    """p(z_t | x_t, m), for mapping and for localization.

    In mapping, `log_prob` scores a particle on the distance field of its own map. In localization, `prepare`
    is called once for the known map, and `log_prob_all` scores all particles on its result.

    Attributes:
        max_beams: number of beams that are scored, evenly spread over the scan (static).
    """

    max_beams: eqx.AbstractVar[int]

    @property
    @abc.abstractmethod
    def independent_count(self) -> float | Float[Array, ""]:
        """Return the number of independent beams that a scan counts for."""

    def num_scored(self, scan: LidarScan) -> Float[Array, ""]:
        """Return how many of the scored beams have a return."""
        return jnp.sum(scan.valid[spread_beams(scan.num_beams, self.max_beams)], dtype=jnp.float32)

    def prepare(self, map: KnownMap) -> Any:
        """Compute the look-up data for a known map, in the map frame; by default, the distance field."""
        return map.field()

    @abc.abstractmethod
    def log_prob(self, prepared: Any, scan: LidarScan, pose: Float[Array, "3"]) -> Float[Array, ""]:
        """Return the natural log of the likelihood of a scan at one pose.

        Args:
            prepared: a `Field`, or the result of `prepare`.
            scan: ranges `[B]` in meters and mask `[B]`.
            pose: `[3]` base pose (m, m, rad) in the frame of `prepared`.
        """

    def log_prob_all(self, prepared: Any, scan: LidarScan, poses: Float[Array, "N 3"]) -> Float[Array, "N"]:
        """Return `log_prob` at each pose `[N, 3]`; override it where a batched evaluation is faster."""
        return jax.vmap(self.log_prob, (None, None, 0))(prepared, scan, poses)
