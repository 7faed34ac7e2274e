"""The posterior of a pose given map, scan and motion model; proposals compare poses by it."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxslam.core import se2
from jaxslam.core.flags import Flag
from jaxslam.core.types import Scalar
from jaxslam.lidar.beams import ScanPoints
from jaxslam.matching.gauss_newton import PosePrior
from jaxslam.matching.heading import HeadingSearch
from jaxslam.proposal.base import ProposalContext, ProposalResult


class Candidate(eqx.Module):
    """A pose and its value under the posterior.

    Attributes:
        pose: `[3]` (m, m, rad, world frame).
        log_likelihood: log p(z | x, m).
        log_posterior: `PosePosterior.log_prob`.
    """

    pose: Float[Array, "*n 3"]
    log_likelihood: Float[Array, "*n"]
    log_posterior: Float[Array, "*n"]


class PosePosterior(eqx.Module):
    r"""$\log\Gamma(x) = \log p(z\mid x,m) + w\,\log p(x\mid x_{t-1},u)$, Liang et al. (12).

    Attributes:
        context: map, scan and sensor model.
        prior: p(x | x_prev, u) around the draw of the motion model.
        prior_weight: w. The sensor model gives a scan less weight than its beams would have if they were
            independent, so the prior at full weight would win against the scan.
    """

    context: ProposalContext
    prior: PosePrior
    prior_weight: Scalar

    def log_prob(self, pose: Float[Array, "3"]) -> Float[Array, ""]:
        """Return log Γ at a pose `[3]`."""
        return self.evaluate(pose).log_posterior

    def evaluate(self, pose: Float[Array, "3"]) -> Candidate:
        """Return the pose `[3]` with its likelihood and posterior."""
        log_likelihood = self.context.log_likelihood(pose)
        return Candidate(pose, log_likelihood, log_likelihood + self.prior_weight * self.prior.log_prob(pose))

    def evaluate_pair(self, one: Float[Array, "3"], other: Float[Array, "3"]) -> tuple[Candidate, Candidate]:
        """Evaluate two poses in one compiled body, which shares the computations on the scan alone."""
        both = jax.vmap(self.evaluate)(jnp.stack([one, other]))
        return jax.tree.map(lambda leaf: leaf[0], both), jax.tree.map(lambda leaf: leaf[1], both)


def best_of(best: Candidate, other: Candidate) -> Candidate:
    """Return the candidate with the higher posterior, the first of equals; a NaN never wins."""
    wins = other.log_posterior > best.log_posterior
    return jax.tree.map(lambda new, old: jnp.where(wins, new, old), other, best)


def finalize(
    drawn: Candidate,
    chosen: Candidate,
    enough: Bool[Array, ""],
    searched: Bool[Array, ""],
    log_ratio: Scalar = 0.0,
) -> ProposalResult:
    """Return the chosen pose, or the draw of the motion model if the scan has too few beams.

    Args:
        drawn: pose drawn from the motion model.
        chosen: pose chosen by the proposal.
        enough: whether the scan has enough valid beams.
        searched: whether the particle had lost the map and was searched for.
        log_ratio: log p(x | x_prev, u) − log q(x) at `chosen`; 0 for a proposal without a density, whose
            weight is the likelihood alone, as gmapping computes it.
    """
    few = jnp.where(enough, 0, Flag.FEW_VALID_BEAMS.value)
    lost = jnp.where(searched, Flag.SEARCHED.value, 0)
    return ProposalResult(
        pose=jnp.where(enough, chosen.pose, drawn.pose),
        log_likelihood=jnp.where(enough, chosen.log_likelihood, drawn.log_likelihood),
        log_ratio=jnp.where(enough, log_ratio, jnp.zeros((), jnp.float32)),
        flags=(few | lost).astype(jnp.int32),
    )


def align_heading(
    search: HeadingSearch,
    context: ProposalContext,
    ends: ScanPoints,
    pose: Float[Array, "3"],
    drawn: Float[Array, "3"],
) -> Float[Array, "3"]:
    """Turn a draw `[3]` of the motion model to the best-fitting heading near that of the odometry.

    The odometry starts at `pose` `[3]`; the end points are in the base frame.
    """
    predicted = se2.compose(pose, context.odometry.delta)
    sigma = jnp.sqrt(context.motion.covariance(context.odometry)[2, 2])
    return search.search(context.field.coarse, ends, drawn[:2], predicted[2], sigma)
