"""What the proposals that look at the map share: posing candidates and comparing them."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxslam.core import se2
from jaxslam.core.flags import Flag
from jaxslam.core.types import LidarScan, OdometryIncrement
from jaxslam.grid.field import DistanceField, Field
from jaxslam.lidar.beams import ScanPoints
from jaxslam.matching.gauss_newton import PosePrior
from jaxslam.matching.heading import HeadingSearch
from jaxslam.motion.base import AbstractMotionModel
from jaxslam.proposal.base import Proposed
from jaxslam.sensor.base import AbstractSensorModel


class Candidate(eqx.Module):
    """A pose that was looked at.

    Attributes:
        pose: `[3]` (m, m, rad, world frame).
        log_likelihood: of the scan there.
        score: that and what the prior says.
    """

    pose: Float[Array, "*n 3"]
    log_likelihood: Float[Array, "*n"]
    score: Float[Array, "*n"]


class Judge(eqx.Module):
    r"""$\log\Gamma(x) = \log p(z\mid x,m) + w\,\log p(x\mid x_{t-1},u)$, tobacco (12).

    Attributes:
        field: the particle's map.
        scan: z.
        sensor: p(z | x, m).
        prior: p(x | x_prev, u) about the motion model's draw.
        prior_score: w: the sensor model counts a scan for less than its beams, and the prior must not win.
    """

    field: Field
    scan: LidarScan
    sensor: AbstractSensorModel
    prior: PosePrior
    prior_score: float | Float[Array, ""]

    def candidate(self, pose: Float[Array, "3"]) -> Candidate:
        """The pose `[3]` with its score."""
        log_likelihood = self.sensor.log_prob(self.field, self.scan, pose)
        return Candidate(pose, log_likelihood, log_likelihood + self.prior_score * self.prior.log_prob(pose))

    def pair(self, one: Float[Array, "3"], other: Float[Array, "3"]) -> tuple[Candidate, Candidate]:
        """Two poses: compiled once for both, and what the scan alone decides is shared."""
        both = jax.vmap(self.candidate)(jnp.stack([one, other]))
        return jax.tree.map(lambda leaf: leaf[0], both), jax.tree.map(lambda leaf: leaf[1], both)


def better(best: Candidate, other: Candidate) -> Candidate:
    """The higher-scoring of two, the first of equals; a NaN never wins."""
    wins = other.score > best.score
    return jax.tree.map(lambda new, old: jnp.where(wins, new, old), other, best)


def settle(
    drawn: Candidate,
    chosen: Candidate,
    enough: Bool[Array, ""],
    searched: Bool[Array, ""],
    log_ratio: Float[Array, ""] | None = None,
) -> Proposed:
    """What a proposal ends with: the pose that it chose, or the draw where the scan says too little.

    Args:
        drawn: from the motion model.
        chosen: by the proposal.
        enough: whether the scan has beams enough.
        searched: whether the particle was lost.
        log_ratio: log p(x | x_prev, u) − log q(x) at `chosen`. None for a proposal without a density: its
            weight is the likelihood alone, as gmapping computes it.
    """
    few = jnp.where(enough, 0, Flag.FEW_VALID_BEAMS.value)
    lost = jnp.where(searched, Flag.SEARCHED.value, 0)
    log_ratio = jnp.zeros((), jnp.float32) if log_ratio is None else log_ratio
    return Proposed(
        pose=jnp.where(enough, chosen.pose, drawn.pose),
        log_likelihood=jnp.where(enough, chosen.log_likelihood, drawn.log_likelihood),
        log_ratio=jnp.where(enough, log_ratio, 0.0),
        flags=(few | lost).astype(jnp.int32),
    )


def turned_to_map(
    search: HeadingSearch,
    field: Field,
    ends: ScanPoints,
    motion: AbstractMotionModel,
    odometry: OdometryIncrement,
    pose: Float[Array, "3"],
    drawn: Float[Array, "3"],
) -> Float[Array, "3"]:
    """A draw `[3]` from `pose` `[3]`, turned to where the scan fits best around the odometry's heading."""
    predicted = se2.compose(pose, odometry.delta)
    sigma = jnp.sqrt(motion.covariance(odometry)[2, 2])
    return search.search(field.coarse, ends, drawn[:2], predicted[2], sigma)


def share_explained(field: DistanceField, ends: ScanPoints, pose: Float[Array, "3"]) -> Float[Array, ""]:
    """Share of the valid beams that end near an obstacle, or where the map knows nothing."""
    squared, unseen = field.look_up(se2.apply(pose, ends.points))
    explained: Bool[Array, "B"] = unseen | (squared < (field.radius * field.resolution) ** 2)
    num_valid = jnp.sum(ends.valid, dtype=jnp.float32)
    return jnp.sum(ends.valid & explained, dtype=jnp.float32) / jnp.maximum(num_valid, 1.0)
