"""The second paper's proposal: scan matching finds the mode, a Gaussian around it is drawn from."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from jaxslam.core import se2
from jaxslam.core.flags import Flag
from jaxslam.core.validation import require_at_least_zero
from jaxslam.lidar.beams import scan_points
from jaxslam.proposal.base import AbstractProposal, ProposalContext, ProposalResult
from jaxslam.proposal.matched import MatchedProposal
from jaxslam.proposal.pose_gaussian import PosesAround
from jaxslam.proposal.prior import PriorTrust


class GaussianProposal(AbstractProposal):
    r"""Mine (16)–(22): a pose from the Gaussian of the scan's likelihood around its mode, weighed by $\eta$.

    Where the match explains too few of the beams, the particle goes where the motion model says and its step
    is flagged `MATCH_FAILED`.

    Attributes:
        matcher: finds x*, (16).
        around: K poses around it and their moments, (19)–(21).
        prior: how much p(x | x_prev, u) is trusted in the moments: as it stands. The match trusts it less,
            but about the particle's own draw.
        sharpness: log-likelihoods are sharpened by it for the moments, and log η blunted: the sensor model
            counts a scan for less than its beams, which is right for choosing among particles, but knows a
            pose less well than a match does. 1 is the paper's.
        odometry_weight: power of p(x | x_prev, u) in the moments. 0 holds it constant near the mode, (18),
            which lets the particles wander along a corridor without features; 1 keeps it.
        failed_below: share of the valid beams near an obstacle, or where the map knows nothing, under which
            the match has failed.

    References:
        The second paper, "mine"; Grisetti et al. 2007, section III-B.
    """

    matcher: MatchedProposal = MatchedProposal()
    around: PosesAround = PosesAround(spread=0.005)
    prior: PriorTrust = PriorTrust(translation=1.0, rotation=1.0)
    sharpness: float | Float[Array, ""] = 100.0
    odometry_weight: float | Float[Array, ""] = 1.0
    failed_below: float | Float[Array, ""] = 0.3

    def __check_init__(self):
        require_at_least_zero(self, positive=("sharpness",))

    def sample(self, key: PRNGKeyArray, pose: Float[Array, "3"], context: ProposalContext) -> ProposalResult:
        """Matches, fits a Gaussian to the poses around the match, and draws from it."""
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
        # (22): likelihood and ratio make η.
        log_ratio = jnp.where(failed, 0.0, around.log_eta / self.sharpness - log_likelihood)
        flag = jnp.where(enough & failed, Flag.MATCH_FAILED.value, 0)
        return ProposalResult(
            pose=chosen,
            log_likelihood=log_likelihood,
            log_ratio=log_ratio,
            flags=(matched.flags | flag).astype(jnp.int32),
        )
