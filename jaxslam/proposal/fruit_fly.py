"""The improved filter's proposal: a draw from the odometry, ICP, and a swarm of fruit flies around it."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from jaxslam import se2
from jaxslam.branch import run_if
from jaxslam.checks import require_at_least_zero
from jaxslam.lidar.beams import ScanPoints, scan_points
from jaxslam.lidar.subset import spread_beams
from jaxslam.matching.correlative import CorrelativeSearch
from jaxslam.matching.gauss_newton import PosePrior
from jaxslam.matching.heading import HeadingSearch
from jaxslam.matching.icp import ICP
from jaxslam.motion.base import AbstractMotionModel
from jaxslam.optimise.fruit_fly import FruitFlies
from jaxslam.proposal.base import AbstractProposal, Proposed
from jaxslam.proposal.candidate import Candidate, Judge, better, prior_about, settle, share_explained
from jaxslam.sensor.base import AbstractSensorModel
from jaxslam.sensor.field import DistanceField, Field
from jaxslam.types import StepInputs


class FruitFlyProposal(AbstractProposal):
    r"""Tobacco (12)–(18): ICP moves the draw into the likely region, a swarm finds the best pose there.

    The swarm's fitness is $\Gamma(x) = p(z|x,m)\,p(x|x_{t-1},u)$ on the particle's own map, with some of the
    beams and without interpolation; its winner is taken if the sensor model agrees. An optimiser has no
    density: the weight is the likelihood at the pose, as gmapping's, and `log_ratio` is 0.

    Attributes:
        heading: which way to look first.
        icp: alignment from there.
        flies: the swarm, from the best so far.
        search: wider search, run where fewer than `lost_below` of the beams meet the map.
        prior_translation: what the motion model's precision in position counts for.
        prior_rotation: and its precision in heading.
        prior_score: what that prior counts for where candidates are compared.
        step_translation: scale of a fly's step, metres.
        step_rotation: and in heading, radians.
        reach_translation: flies stay within so many metres of where they set out, along x and y.
        reach_rotation: and within so many radians.
        sigma_hit: spread of end points around obstacles in the swarm's fitness, metres.
        beam_score: what one beam on an obstacle is worth in it, against the prior, nats.
        lost_below: share of valid beams near an obstacle, or where the map knows nothing, under which the
            match is not trusted.
        min_valid_beams: with fewer the pose is the motion model's draw.
        use_icp: whether ICP is run (static).
        use_flies: whether the swarm is (static).
        polish: whether the swarm's winner is aligned again (static).
        max_beams: beams used by ICP, evenly spread over the scan (static).
        fly_beams: beams of a fly's fitness (static).

    References:
        The first paper, "tobacco"; how its gaps are read is in the docs of `FruitFlies`.
    """

    heading: HeadingSearch = HeadingSearch()
    icp: ICP = ICP()
    flies: FruitFlies = FruitFlies()
    search: CorrelativeSearch = CorrelativeSearch()
    prior_translation: float | Float[Array, ""] = 0.1
    prior_rotation: float | Float[Array, ""] = 0.1
    prior_score: float | Float[Array, ""] = 0.5
    step_translation: float | Float[Array, ""] = 0.03
    step_rotation: float | Float[Array, ""] = 0.02
    reach_translation: float | Float[Array, ""] = 0.5
    reach_rotation: float | Float[Array, ""] = 0.3
    sigma_hit: float | Float[Array, ""] = 0.1
    beam_score: float | Float[Array, ""] = 0.1
    lost_below: float | Float[Array, ""] = 0.5
    min_valid_beams: float | Float[Array, ""] = 5.0
    use_icp: bool = eqx.field(static=True, default=True)
    use_flies: bool = eqx.field(static=True, default=True)
    polish: bool = eqx.field(static=True, default=True)
    max_beams: int = eqx.field(static=True, default=180)
    fly_beams: int = eqx.field(static=True, default=60)

    def __check_init__(self):
        require_at_least_zero(self, positive=("sigma_hit",))

    def sample(
        self,
        key: PRNGKeyArray,
        pose: Float[Array, "3"],
        inputs: StepInputs,
        field: Field,
        motion: AbstractMotionModel,
        sensor: AbstractSensorModel,
    ) -> Proposed:
        """Draws, looks round, aligns, lets the flies out, searches if lost, and keeps the best."""
        drawn = motion.sample(key, pose, inputs.odometry)
        key_flies = jax.random.fold_in(key, 1)
        prior = prior_about(motion, inputs.odometry, drawn, self.prior_translation, self.prior_rotation)
        judge = Judge(field, inputs.scan, sensor, prior, self.prior_score)
        ends = scan_points(inputs.scan, self.max_beams)

        def align(start: Float[Array, "3"]) -> Float[Array, "3"]:
            return self.icp.match(field, ends, start).pose if self.use_icp else start

        predicted = se2.compose(pose, inputs.odometry.delta)
        sigma = jnp.sqrt(motion.covariance(inputs.odometry)[2, 2])
        turned = self.heading.search(field.coarse, ends, drawn[:2], predicted[2], sigma)
        start, aligned = judge.pair(drawn, align(turned))
        best = better(start, aligned)
        enough = jnp.sum(ends.valid, dtype=jnp.float32) >= self.min_valid_beams
        lost = enough & (share_explained(field.fine, ends, best.pose) < self.lost_below)

        def search(best: Candidate) -> Candidate:
            # From the carry and not from the draw: what does not change in a loop, XLA computes before it.
            found = self.search.search(field, ends, best.pose, prior)
            one, other = judge.pair(found, align(found))
            return better(better(best, one), other)

        best = run_if(lost, search, best)
        if self.use_flies:
            found = self.swarm(key_flies, field.fine, ends, best.pose, prior)
            best = better(best, judge.candidate(align(found) if self.polish else found))
        return settle(start, best, enough, lost)

    def swarm(
        self,
        key: PRNGKeyArray,
        field: DistanceField,
        ends: ScanPoints,
        start: Float[Array, "3"],
        prior: PosePrior,
    ) -> Float[Array, "3"]:
        """Best pose that a swarm comes to, by its own fitness.

        Args:
            key: PRNG key.
            field: the particle's map.
            ends: the scan, of which `fly_beams` are looked at.
            start: `[3]` where the flies set out, and what the result is no worse than.
            prior: p(x | x_prev, u).
        """
        chosen = spread_beams(ends.valid.shape[0], self.fly_beams)
        points, valid = ends.points[chosen], ends.valid[chosen]
        total = jnp.sum(ends.valid, dtype=jnp.float32)
        share = total / jnp.maximum(jnp.sum(valid, dtype=jnp.float32), 1.0)

        def fitness(pose: Float[Array, "3"]) -> Float[Array, ""]:
            squared, unseen = field.look_up(se2.apply(pose, points))
            on_map = jnp.exp(-0.5 * squared / self.sigma_hit**2)
            scores = jnp.where(valid & ~unseen, on_map, 0.0)
            return self.beam_score * share * jnp.sum(scores) + self.prior_score * prior.log_prob(pose)

        scale = jnp.asarray([self.step_translation, self.step_translation, self.step_rotation])
        reach = jnp.asarray([self.reach_translation, self.reach_translation, self.reach_rotation])
        return self.flies.maximise(fitness, key, start, scale, start - reach, start + reach).position
