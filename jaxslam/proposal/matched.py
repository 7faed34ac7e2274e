"""gmapping's proposal: draw from the motion model, then match the scan from there."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from jaxslam.core.types import StepInputs
from jaxslam.core.validation import require_at_least_zero
from jaxslam.grid.field import Field
from jaxslam.lidar.beams import scan_points
from jaxslam.matching.correlative import CorrelativeSearch
from jaxslam.matching.gauss_newton import GaussNewton
from jaxslam.matching.heading import HeadingSearch
from jaxslam.motion.base import AbstractMotionModel
from jaxslam.proposal.base import AbstractProposal, Proposed
from jaxslam.proposal.posterior import Candidate, Judge, better, settle, share_explained, turned_to_map
from jaxslam.proposal.prior import PriorTrust
from jaxslam.sensor.base import AbstractSensorModel
from jaxslam.xla.control_flow import run_if


class MatchedProposal(AbstractProposal):
    """Mode of p(z | x, m) p(x | x_drawn), where x_drawn is a draw from the motion model.

    Each particle keeps its own draw as the prior's centre, so the particles stay spread where the scan
    says nothing, as along a corridor, and agree where it does.

    Attributes:
        heading: which way to look first.
        coarse: matcher on the coarse field, a basin of about a metre: one of the starts when lost.
        fine: matcher on the map's own resolution, a basin of some 30 cm.
        search: wider search, run where fewer than `lost_below` of the beams meet the map.
        prior: how much the motion model is trusted.
        prior_score: what that prior counts for where candidates are compared: the sensor model counts a
            beam for less than the match does.
        lost_below: share of valid beams near an obstacle, or where the map knows nothing, under which the
            match is not trusted.
        min_valid_beams: with fewer the pose is the motion model's draw.
        max_beams: beams used for matching, evenly spread over the scan (static): half of them made
            long corridors worse.

    References:
        Grisetti et al. 2007, section III (mode by scan matching; weight: the likelihood at the mode, as
        gmapping computes it, so `log_ratio` is 0).
    """

    heading: HeadingSearch = HeadingSearch()
    coarse: GaussNewton = GaussNewton(sigma_cells=1.5, num_iterations=5)
    fine: GaussNewton = GaussNewton()
    search: CorrelativeSearch = CorrelativeSearch()
    prior: PriorTrust = PriorTrust()
    prior_score: float | Float[Array, ""] = 0.5
    lost_below: float | Float[Array, ""] = 0.5
    min_valid_beams: float | Float[Array, ""] = 5.0
    max_beams: int = eqx.field(static=True, default=400)

    def __check_init__(self):
        require_at_least_zero(self)

    def sample(
        self,
        key: PRNGKeyArray,
        pose: Float[Array, "3"],
        inputs: StepInputs,
        field: Field,
        motion: AbstractMotionModel,
        sensor: AbstractSensorModel,
    ) -> Proposed:
        """Draws, looks round, matches, searches if lost, and keeps the best of all that was seen."""
        drawn = motion.sample(key, pose, inputs.odometry)
        prior = self.prior.about(motion, inputs.odometry, drawn)
        judge = Judge(field, inputs.scan, sensor, prior, self.prior_score)
        ends = scan_points(inputs.scan, self.max_beams)

        def refine(start: Float[Array, "3"]) -> Float[Array, "3"]:
            return self.fine.match(field.fine, ends, start, prior)

        turned = turned_to_map(self.heading, field, ends, motion, inputs.odometry, pose, drawn)
        start, refined = judge.pair(drawn, refine(turned))
        matched = better(start, refined)

        def search(best: Candidate) -> Candidate:
            # From the carry and not from the draw: what does not change in a loop, XLA computes before it.
            coarse = self.coarse.match(field.coarse, ends, best.pose, prior)
            found = self.search.search(field, ends, best.pose, prior)
            refined = jax.vmap(refine)(jnp.stack([coarse, found]))
            one, other = judge.pair(refined[0], refined[1])
            return better(better(best, one), other)

        enough = jnp.sum(ends.valid, dtype=jnp.float32) >= self.min_valid_beams
        lost = enough & (share_explained(field.fine, ends, matched.pose) < self.lost_below)
        matched = run_if(lost, search, matched)
        return settle(start, matched, enough, lost)
