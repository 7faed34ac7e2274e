"""What a sensor model is."""

import abc

import equinox as eqx
from jaxtyping import Array, Float

from jaxslam.core.types import LidarScan
from jaxslam.grid.field import Field


class AbstractSensorModel(eqx.Module):
    """p(z_t | x_t, m) for one particle."""

    @abc.abstractmethod
    def log_prob(self, field: Field, scan: LidarScan, pose: Float[Array, "3"]) -> Float[Array, ""]:
        """Natural log of the likelihood of a scan at a base pose `[3]` (m, m, rad, world frame).

        Vmap over particles with `in_axes=(0, None, 0)`.
        """
