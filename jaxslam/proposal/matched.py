"""gmapping's proposal: draw from the motion model, then match the scan from there."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from jaxslam.core.types import Scalar
from jaxslam.core.validation import require_at_least_zero
from jaxslam.lidar.beams import scan_points
from jaxslam.matching.correlative import CorrelativeSearch
from jaxslam.matching.gauss_newton import GaussNewton
from jaxslam.matching.heading import HeadingSearch
from jaxslam.proposal.base import AbstractProposal, ProposalContext, ProposalResult
from jaxslam.proposal.posterior import Candidate, PosePosterior, align_heading, best_of, finalize
from jaxslam.proposal.prior import PriorTrust
from jaxslam.xla.control_flow import run_if


class MatchedProposal(AbstractProposal):
    """Mode of p(z | x, m) p(x | x_drawn), where x_drawn is a draw from the motion model.

    The prior of each particle is centered on its own draw. The particles therefore stay spread where the scan
    does not constrain the pose, as along a corridor, and agree where it does.

    Attributes:
        heading: search over headings before the match.
        coarse: matcher on the coarse field, with a basin of about a meter; finds another start if lost.
        fine: matcher at the map's own resolution, with a basin of about 30 cm.
        search: wider search, run where fewer than `lost_below` of the beams match the map.
        prior: trust in the motion model.
        prior_weight: weight of that prior when candidates are compared; the sensor model gives a beam less
            weight than the matcher does.
        lost_below: share of valid beams near an obstacle or in unseen space below which the match is not
            trusted.
        min_valid_beams: with fewer valid beams the pose is the motion model's draw.
        max_beams: beams used for matching, evenly spread over the scan (static). With half the beams, maps of
            long corridors are worse.

    References:
        Grisetti et al. 2007, section III (mode by scan matching). The weight is the likelihood at the mode,
        as in gmapping, so `log_ratio` is 0.
    """

    heading: HeadingSearch = HeadingSearch()
    coarse: GaussNewton = GaussNewton(sigma_cells=1.5, num_iterations=5)
    fine: GaussNewton = GaussNewton()
    search: CorrelativeSearch = CorrelativeSearch()
    prior: PriorTrust = PriorTrust()
    prior_weight: Scalar = 0.5
    lost_below: Scalar = 0.5
    min_valid_beams: Scalar = 5.0
    max_beams: int = eqx.field(static=True, default=400)

    def __check_init__(self):
        require_at_least_zero(self)

    def sample(self, key: PRNGKeyArray, pose: Float[Array, "3"], context: ProposalContext) -> ProposalResult:
        """Draw, search headings, match, search wider if lost, and keep the best pose."""
        field = context.field
        drawn = context.motion.sample(key, pose, context.odometry)
        prior = self.prior.around(context.motion, context.odometry, drawn)
        posterior = PosePosterior(context, prior, self.prior_weight)
        ends = scan_points(context.scan, self.max_beams)

        def refine(start: Float[Array, "3"]) -> Float[Array, "3"]:
            return self.fine.match(field.fine, ends, start, prior)

        turned = align_heading(self.heading, context, ends, pose, drawn)
        start, refined = posterior.evaluate_pair(drawn, refine(turned))
        matched = best_of(start, refined)

        def search(best: Candidate) -> Candidate:
            # From the carry, not from the draw: XLA moves what is constant in a loop out of it.
            coarse = self.coarse.match(field.coarse, ends, best.pose, prior)
            found = self.search.search(field, ends, best.pose, prior)
            refined = jax.vmap(refine)(jnp.stack([coarse, found]))
            one, other = posterior.evaluate_pair(refined[0], refined[1])
            return best_of(best_of(best, one), other)

        enough = jnp.sum(ends.valid, dtype=jnp.float32) >= self.min_valid_beams
        lost = enough & (field.fine.inlier_ratio(ends, matched.pose) < self.lost_below)
        matched = run_if(lost, search, matched)
        return finalize(start, matched, enough, lost)
