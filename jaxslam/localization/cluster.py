"""One pose from many particles: the heaviest cluster, not the mean over all."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxslam.core import se2
from jaxslam.core.validation import require_at_least_zero


class Cluster(eqx.Module):
    """Particles that lie together.

    Attributes:
        mean: `[3]` (m, m, rad, world frame).
        covariance: `[3, 3]` (m², m·rad, rad²).
        weight: share of the whole belief, 0 to 1.
    """

    mean: Float[Array, "*batch 3"]
    covariance: Float[Array, "*batch 3 3"]
    weight: Float[Array, "*batch"]

    @property
    def deviation(self) -> Float[Array, "*batch"]:
        """Standard deviation of the position: root of the sum of both variances, meters."""
        return jnp.sqrt(self.covariance[..., 0, 0] + self.covariance[..., 1, 1])


def heaviest_particle(
    poses: Float[Array, "N 3"], weights: Float[Array, "N"], bins: Int[Array, "N"], num_bins: int
) -> Float[Array, "3"]:
    """The heaviest particle of the heaviest bin: a start that is no lonely one with a lucky scan.

    Args:
        poses: `[N, 3]` (m, m, rad, world frame).
        weights: `[N]`; 0 for those that do not count.
        bins: `[N]` of each.
        num_bins: how many there are (static).
    """
    totals = jax.ops.segment_sum(weights, bins, num_bins)[bins]
    in_heaviest = totals >= jnp.max(totals)
    return poses[jnp.argmax(jnp.where(in_heaviest, weights, -1.0))]


class Clustering(eqx.Module):
    """Mean shift from a start: the window goes to the mean of what lies in it, until that is all.

    The mean over all particles would lie between two rooms that look alike, where the robot is not.

    Attributes:
        reach: particles within so many meters of the mean belong to the cluster.
        reach_rotation: and within so many radians.
        num_shifts: of the window (static).
    """

    reach: float | Float[Array, ""] = 1.0
    reach_rotation: float | Float[Array, ""] = 0.5
    num_shifts: int = eqx.field(static=True, default=5)

    def __check_init__(self):
        require_at_least_zero(self, positive=("reach", "reach_rotation"))

    def around(
        self, poses: Float[Array, "N 3"], weights: Float[Array, "N"], start: Float[Array, "3"]
    ) -> Cluster:
        """The cluster that a start pose leads to.

        Args:
            poses: `[N, 3]` (m, m, rad, world frame).
            weights: `[N]` normalized; 0 for those that do not count.
            start: `[3]` in or near the cluster, such as its heaviest particle.
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
