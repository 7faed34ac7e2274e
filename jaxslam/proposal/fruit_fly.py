"""The proposal of Liang et al.: a draw from the motion model, ICP, and a swarm of fruit flies."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Key, PRNGKeyArray

from jaxslam.core import se2
from jaxslam.core.types import Scalar
from jaxslam.core.validation import require_at_least_zero, require_one_of
from jaxslam.grid.field import DistanceField, Field
from jaxslam.lidar.beams import ScanPoints, scan_points
from jaxslam.matching.correlative import CorrelativeSearch
from jaxslam.matching.gauss_newton import PosePrior
from jaxslam.matching.heading import HeadingSearch
from jaxslam.matching.icp import ICP
from jaxslam.matching.swarm import FruitFlies
from jaxslam.proposal.base import AbstractProposal, ProposalContext, ProposalResult
from jaxslam.proposal.pose_gaussian import PosesAround
from jaxslam.proposal.posterior import Candidate, PosePosterior, align_heading, best_of, finalize
from jaxslam.proposal.prior import PriorTrust
from jaxslam.xla.control_flow import run_if


class _Aligned(eqx.Module):
    """A particle before the swarm runs; `lost` if it had lost the map and was searched for."""

    drawn: Candidate
    best: Candidate
    prior: PosePrior
    enough: Bool[Array, ""]
    lost: Bool[Array, ""]


class FruitFlyProposal(AbstractProposal):
    r"""Liang et al. (12)–(18): ICP moves the draw into the likely region; a swarm finds the best pose there.

    The swarm's fitness is $\Gamma(x) = p(z|x,m)\,p(x|x_{t-1},u)$ on the particle's own map, with some of the
    beams and without interpolation; its result is accepted only if the sensor model also rates it higher. An
    optimizer has no density, so `weight` selects the definition of the weight.

    Attributes:
        heading: search over headings before ICP.
        icp: alignment from the best heading.
        flies: the swarm, started at the best pose so far.
        search: wider search, run where fewer than `lost_below` of the beams match the map.
        prior: trust in the motion model.
        prior_weight: weight of that prior when candidates are compared.
        step_translation: scale of a fly's step, meters.
        step_rotation: scale of a fly's step in heading, radians.
        reach_translation: largest distance of a fly from its start along x and along y, meters.
        reach_rotation: largest rotation of a fly from its start, radians.
        sigma_hit: spread of end points around obstacles in the swarm's fitness, meters.
        scan_score: fitness of a scan whose beams all end on obstacles, relative to the prior, nats.
        lost_below: share of valid beams near an obstacle or in unseen space below which the match is not
            trusted.
        min_valid_beams: with fewer valid beams the pose is the motion model's draw.
        around: poses around the best, for `weight="density"`.
        sharpness: factor on log-likelihoods for fitting and drawing; log-weights are divided by it. The
            sensor model gives a scan less weight than its beams have together. This suits a choice among
            particles, but understates how well a match determines the pose.
        weight: "likelihood": the best pose, weighted by the scan's likelihood there, as in gmapping;
            "density": a draw from the Gaussian around it, weighted by p(z|x,m) p(x|x_prev,u) / q(x) (static).
        swarm: "own": every particle has a swarm; "particles": the particles form one swarm (static).
        use_icp: whether ICP is run (static).
        use_flies: whether the swarm is run (static).
        polish: whether the swarm's result is aligned again by ICP (static).
        max_beams: beams used by ICP, evenly spread over the scan (static).
        fly_beams: beams of a fly's fitness (static).

    References:
        Liang et al.; see `FruitFlies` for how gaps in the paper are filled.
    """

    heading: HeadingSearch = HeadingSearch()
    icp: ICP = ICP()
    flies: FruitFlies = FruitFlies()
    search: CorrelativeSearch = CorrelativeSearch()
    prior: PriorTrust = PriorTrust()
    prior_weight: Scalar = 0.3
    step_translation: Scalar = 0.03
    step_rotation: Scalar = 0.02
    reach_translation: Scalar = 0.5
    reach_rotation: Scalar = 0.3
    sigma_hit: Scalar = 0.1
    scan_score: Scalar = 18.0
    lost_below: Scalar = 0.5
    min_valid_beams: Scalar = 5.0
    around: PosesAround = PosesAround()
    sharpness: Scalar = 10.0
    weight: str = eqx.field(static=True, default="likelihood")
    swarm: str = eqx.field(static=True, default="own")
    use_icp: bool = eqx.field(static=True, default=True)
    use_flies: bool = eqx.field(static=True, default=True)
    polish: bool = eqx.field(static=True, default=True)
    max_beams: int = eqx.field(static=True, default=180)
    fly_beams: int = eqx.field(static=True, default=60)

    def __check_init__(self):
        require_at_least_zero(self, positive=("sigma_hit", "sharpness"))
        require_one_of(self, "weight", ("likelihood", "density"))
        require_one_of(self, "swarm", ("own", "particles"))

    def sample(self, key: PRNGKeyArray, pose: Float[Array, "3"], context: ProposalContext) -> ProposalResult:
        """Draw, search headings, run ICP, search wider if lost, run the swarm, and keep the best pose."""
        aligned = self._align(key, pose, context)
        found = aligned.best.pose
        if self.use_flies:
            beams = scan_points(context.scan, self.fly_beams)
            found = self.fly(jax.random.fold_in(key, 1), context.field.fine, beams, aligned.prior, found)
        return self._finish(jax.random.fold_in(key, 2), aligned, found, pose, context)

    def sample_all(
        self, keys: Key[Array, "N"], poses: Float[Array, "N 3"], context: ProposalContext
    ) -> ProposalResult:
        """Draw for all particles, each with its own swarm, or all of them as one swarm."""
        if self.swarm == "own" or not self.use_flies:
            return AbstractProposal.sample_all(self, keys, poses, context)
        aligned = context.for_each(self._align, keys, poses)
        beams = scan_points(context.scan, self.fly_beams)
        fitness = partial(jax.vmap(self._fitness, (0, None, 0, 0)), context.field.fine, beams, aligned.prior)
        # Crossover averages headings, so all of them must lie within ±π of each other.
        starts = aligned.best.pose
        first = starts[0, 2]
        starts = starts.at[:, 2].set(first + se2.wrap(starts[:, 2] - first))
        key_flies = jax.random.fold_in(keys[0], 1)
        found = self.flies.maximize_each(fitness, key_flies, starts, *self._steps_and_bounds(starts)).position
        keys = jax.vmap(jax.random.fold_in, (0, None))(keys, 2)
        return context.for_each(self._finish, keys, aligned, found, poses)

    def fly(
        self,
        key: PRNGKeyArray,
        field: DistanceField,
        beams: ScanPoints,
        prior: PosePrior,
        start: Float[Array, "3"],
    ) -> Float[Array, "3"]:
        """Return the best pose `[3]` of a swarm around `start`, by its fitness; no worse than the start."""
        fitness = partial(self._fitness, field, beams, prior)
        return self.flies.maximize(fitness, key, start, *self._steps_and_bounds(start)).position

    def _align(self, key: PRNGKeyArray, pose: Float[Array, "3"], context: ProposalContext) -> _Aligned:
        """Move a draw of the motion model into the likely region, Liang et al. (12)–(15)."""
        field = context.field
        drawn = context.motion.sample(key, pose, context.odometry)
        prior = self.prior.around(context.motion, context.odometry, drawn)
        posterior = PosePosterior(context, prior, self.prior_weight)
        ends = scan_points(context.scan, self.max_beams)
        turned = align_heading(self.heading, context, ends, pose, drawn)
        start, aligned = posterior.evaluate_pair(drawn, self._icp(field, ends, turned))
        best = best_of(start, aligned)
        enough = jnp.sum(ends.valid, dtype=jnp.float32) >= self.min_valid_beams
        lost = enough & (field.fine.inlier_ratio(ends, best.pose) < self.lost_below)

        def search(best: Candidate) -> Candidate:
            # From the carry, not from the draw: XLA moves what is constant in a loop out of it.
            found = self.search.search(field, ends, best.pose, prior)
            one, other = posterior.evaluate_pair(found, self._icp(field, ends, found))
            return best_of(best_of(best, one), other)

        return _Aligned(start, run_if(lost, search, best), prior, enough, lost)

    def _finish(
        self,
        key: PRNGKeyArray,
        aligned: _Aligned,
        found: Float[Array, "3"],
        pose: Float[Array, "3"],
        context: ProposalContext,
    ) -> ProposalResult:
        """Return the particle's new pose and the terms of its weight."""
        posterior = PosePosterior(context, aligned.prior, self.prior_weight)
        ends = scan_points(context.scan, self.max_beams)
        best = aligned.best
        if self.use_flies:
            polished = self._icp(context.field, ends, found) if self.polish else found
            best = best_of(best, posterior.evaluate(polished))
        if self.weight == "likelihood":
            return finalize(aligned.drawn, best, aligned.enough, aligned.lost)
        key_fit, key_draw = jax.random.split(key)
        around = self.around.fit(key_fit, lambda x: self.sharpness * posterior.log_prob(x), best.pose, ends)
        sampled = posterior.evaluate(around.sample(key_draw))
        log_prior = context.motion.log_prob(sampled.pose, pose, context.odometry)
        log_ratio = log_prior - around.log_prob(sampled.pose)
        return finalize(aligned.drawn, sampled, aligned.enough, aligned.lost, log_ratio / self.sharpness)

    def _icp(self, field: Field, ends: ScanPoints, start: Float[Array, "3"]) -> Float[Array, "3"]:
        return self.icp.match(field, ends, start).pose if self.use_icp else start

    def _fitness(
        self, field: DistanceField, beams: ScanPoints, prior: PosePrior, pose: Float[Array, "3"]
    ) -> Float[Array, ""]:
        """Return log Γ for a fly, Liang et al. (12), from a mean over the scored beams."""
        squared, unseen = field.look_up(se2.apply(pose, beams.points))
        on_map = jnp.exp(-0.5 * squared / self.sigma_hit**2)
        hit = jnp.sum(jnp.where(beams.valid & ~unseen, on_map, 0.0))
        share = hit / jnp.maximum(jnp.sum(beams.valid, dtype=jnp.float32), 1.0)
        return self.scan_score * share + self.prior_weight * prior.log_prob(pose)

    def _steps_and_bounds(
        self, starts: Float[Array, "*N 3"]
    ) -> tuple[Float[Array, "3"], Float[Array, "*N 3"], Float[Array, "*N 3"]]:
        """Return the scale of a step and the bounds of each fly."""
        scale = jnp.asarray([self.step_translation, self.step_translation, self.step_rotation])
        reach = jnp.asarray([self.reach_translation, self.reach_translation, self.reach_rotation])
        reach = jnp.broadcast_to(reach, starts.shape)
        return scale, starts - reach, starts + reach
