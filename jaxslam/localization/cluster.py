"""A pose estimate from many particles: the heaviest cluster instead of the overall mean."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxslam.core import se2
from jaxslam.core.types import Scalar
from jaxslam.core.validation import require_at_least_zero


class Cluster(eqx.Module):
    """A cluster of particles.

    Attributes:
        mean: `[3]` (m, m, rad, world frame).
        covariance: `[3, 3]` (m², m·rad, rad²).
        weight: share of the total weight, 0 to 1.
    """

    mean: Float[Array, "*batch 3"]
    covariance: Float[Array, "*batch 3 3"]
    weight: Float[Array, "*batch"]

    @property
    def deviation(self) -> Float[Array, "*batch"]:
        """Return the standard deviation of the position: root of the sum of both variances, meters."""
        return jnp.sqrt(self.covariance[..., 0, 0] + self.covariance[..., 1, 1])


def heaviest_particle(
    poses: Float[Array, "N 3"], weights: Float[Array, "N"], bins: Int[Array, "N"], num_bins: int
) -> Float[Array, "3"]:
    """Return the heaviest particle of the heaviest bin, so that an isolated particle is never chosen.

    The weights of unused particles are 0; `num_bins` is the total number of bins (static).
    """
    totals = jax.ops.segment_sum(weights, bins, num_bins)[bins]
    in_heaviest = totals >= jnp.max(totals)
    return poses[jnp.argmax(jnp.where(in_heaviest, weights, -1.0))]


class Clustering(eqx.Module):
    """Mean shift: the window moves to the mean of the particles in it, repeatedly.

    The mean over all particles could lie between two similar rooms, where the robot is not.

    Attributes:
        reach: largest distance of a cluster's particles from its mean, meters.
        reach_rotation: largest heading difference of a cluster's particles from its mean, radians.
        num_shifts: number of window shifts (static).
    """

    reach: Scalar = 1.0
    reach_rotation: Scalar = 0.5
    num_shifts: int = eqx.field(static=True, default=5)

    def __check_init__(self):
        require_at_least_zero(self, positive=("reach", "reach_rotation"))

    def around(
        self, poses: Float[Array, "N 3"], weights: Float[Array, "N"], start: Float[Array, "3"]
    ) -> Cluster:
        """Return the cluster that mean shift finds from a start pose `[3]`, such as the heaviest particle.

        The weights are normalized, and 0 for unused particles; poses are in the world frame (m, m, rad).
        """

        def member(mean: Float[Array, "3"]) -> tuple[Float[Array, "N"], Float[Array, "N 3"]]:
            offsets = poses - mean[None]
            offsets = offsets.at[:, 2].set(se2.wrap(offsets[:, 2]))
            squared = offsets[:, 0] ** 2 + offsets[:, 1] ** 2
            inside = (squared <= self.reach**2) & (jnp.abs(offsets[:, 2]) <= self.reach_rotation)
            return jnp.where(inside, weights, 0.0), offsets

        def shift(_: object, mean: Float[Array, "3"]) -> Float[Array, "3"]:
            inside, offsets = member(mean)
            moved = mean + jnp.sum(inside[:, None] * offsets, axis=0) / jnp.maximum(jnp.sum(inside), 1e-12)
            return moved.at[2].set(se2.wrap(moved[2]))

        mean = jax.lax.fori_loop(0, self.num_shifts, shift, start)
        inside, offsets = member(mean)
        weight = jnp.sum(inside)
        share = inside / jnp.maximum(weight, 1e-12)
        offsets = offsets - jnp.sum(share[:, None] * offsets, axis=0)[None]
        return Cluster(mean, (offsets * share[:, None]).T @ offsets, weight)
