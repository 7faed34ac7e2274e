"""The proposal of Yang et al. 2019: a draw from a Gaussian around the mode found by scan matching."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from jaxslam.core import se2
from jaxslam.core.flags import Flag
from jaxslam.core.types import Scalar
from jaxslam.core.validation import require_at_least_zero
from jaxslam.lidar.beams import scan_points
from jaxslam.proposal.base import AbstractProposal, ProposalContext, ProposalResult
from jaxslam.proposal.matched import MatchedProposal
from jaxslam.proposal.pose_gaussian import PosesAround
from jaxslam.proposal.prior import PriorTrust


class GaussianProposal(AbstractProposal):
    r"""Yang et al. 2019 (16)–(22): a draw from a Gaussian around the likelihood's mode, weighted by $\eta$.

    Where the match has too few inliers, the motion model draws the pose instead and the step is flagged
    `MATCH_FAILED`.

    Attributes:
        matcher: finds the mode x*, (16).
        around: K poses around the mode and their moments, (19)–(21).
        prior: trust in p(x | x_prev, u) for the moments: full by default. The matcher trusts it less, but
            centers it on the particle's own draw.
        sharpness: factor on log-likelihoods for the moments; log η is divided by it. The sensor model gives a
            scan less weight than its beams have together. This suits a choice among particles, but
            understates how well a match determines the pose. 1 is the paper's value.
        odometry_weight: power of p(x | x_prev, u) in the moments. 0 treats it as constant near the mode,
            as in (18), which lets the particles drift along a corridor without features; 1 keeps it.
        failed_below: share of the valid beams near an obstacle or in unseen space below which the match has
            failed.

    References:
        Yang et al. 2019; Grisetti et al. 2007, section III-B.
    """

    matcher: MatchedProposal = MatchedProposal()
    around: PosesAround = PosesAround(spread=0.005)
    prior: PriorTrust = PriorTrust(translation=1.0, rotation=1.0)
    sharpness: Scalar = 100.0
    odometry_weight: Scalar = 1.0
    failed_below: Scalar = 0.3

    def __check_init__(self):
        require_at_least_zero(self, positive=("sharpness",))

    def sample(self, key: PRNGKeyArray, pose: Float[Array, "3"], context: ProposalContext) -> ProposalResult:
        """Match, fit a Gaussian to the poses around the match, and draw from it."""
        # (16)
        matched = self.matcher.sample(key, pose, context)
        ends = scan_points(context.scan, self.matcher.max_beams)
        enough = (matched.flags & Flag.FEW_VALID_BEAMS.value) == 0
        failed = ~enough | (context.field.fine.inlier_ratio(ends, matched.pose) < self.failed_below)

        # (18)–(21)
        predicted = se2.compose(pose, context.odometry.delta)
        prior = self.prior.around(context.motion, context.odometry, predicted)

        def log_value(x: Float[Array, "3"]) -> Float[Array, ""]:
            return self.sharpness * context.log_likelihood(x) + self.odometry_weight * prior.log_prob(x)

        around = self.around.fit(jax.random.fold_in(key, 1), log_value, matched.pose, ends)
        drawn = around.sample(jax.random.fold_in(key, 2))

        fallen_back = context.motion.sample(key, pose, context.odometry)
        chosen = jnp.where(failed, fallen_back, drawn)
        log_likelihood = context.log_likelihood(chosen)
        # (22): likelihood times ratio is η.
        log_ratio = jnp.where(failed, 0.0, around.log_eta / self.sharpness - log_likelihood)
        flag = jnp.where(enough & failed, Flag.MATCH_FAILED.value, 0)
        return ProposalResult(
            pose=chosen,
            log_likelihood=log_likelihood,
            log_ratio=log_ratio,
            flags=(matched.flags | flag).astype(jnp.int32),
        )
