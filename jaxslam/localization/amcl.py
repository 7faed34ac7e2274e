"""Adaptive Monte-Carlo localization on a known map, Yang et al. 2019 (8)–(15)."""

from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from jaxslam.core import se2
from jaxslam.core.flags import Flag
from jaxslam.core.linalg import cholesky
from jaxslam.core.types import LidarScan, Scalar, StepInputs
from jaxslam.core.validation import require_at_least_zero
from jaxslam.grid.known_map import KnownMap
from jaxslam.lidar.beams import end_points, inlier_ratio
from jaxslam.localization.cluster import Cluster, Clustering, heaviest_particle
from jaxslam.localization.kld import Bins, KLDSampling
from jaxslam.localization.recovery import Averages, Recovery
from jaxslam.localization.skipping import BeamSkipping
from jaxslam.motion.base import AbstractMotionModel
from jaxslam.range_network.network import RangeNetwork, with_corrected_ranges
from jaxslam.resampling._fixed_point import cumulative_weights, pick
from jaxslam.resampling.ess import effective_sample_size, normalize
from jaxslam.sensor.base import AbstractSensorModel

_STAGE, _NUM_STAGES, _SMALLEST = 4, 4, 512
"""Ratio of successive compiled set sizes, their largest number, and the smallest size. A set of 500 particles
then does not pay for 100 000."""


class AMCLState(eqx.Module):
    """State of the filter between steps.

    Attributes:
        poses: `[N, 3]` base poses (m, m, rad, world frame); entries from `num_particles` on are unused.
        log_weights: `[N]` normalized log-weights; −inf from `num_particles` on.
        num_particles: current number of particles, int32.
        averages: averages of the scans' likelihood.
        converged: whether the particles agreed after the last step.
        num_steps: number of steps taken, int32.
    """

    poses: Float[Array, "N 3"]
    log_weights: Float[Array, "N"]
    num_particles: Int[Array, ""]
    averages: Averages
    converged: Bool[Array, ""]
    num_steps: Int[Array, ""]


class AMCLInfo(eqx.Module):
    """Record of one step.

    Attributes:
        estimate: the heaviest cluster after weighting.
        num_particles: number of weighted particles.
        num_random: number of particles then drawn from the whole map.
        ess: effective sample size before resampling.
        resampled: whether the particles were resampled.
        converged: whether the particles agree: nearly all of the weight is in one small cluster.
        lost: whether the particles agree, but the scan does not match the map there.
        match_score: share of the scan's beams that end near an obstacle at the estimate; NaN for a scan
            without a return.
        flags: `jaxslam.core.flags.Flag` bits, int32.
    """

    estimate: Cluster
    num_particles: Int[Array, "*T"]
    num_random: Int[Array, "*T"]
    ess: Float[Array, "*T"]
    resampled: Bool[Array, "*T"]
    converged: Bool[Array, "*T"]
    lost: Bool[Array, "*T"]
    match_score: Float[Array, "*T"]
    flags: Int[Array, "*T"]


class Agreement(eqx.Module):
    """Thresholds for particles that agree, and for an agreement on a wrong pose.

    Attributes:
        min_weight: smallest share of the total weight in the heaviest cluster, 0 to 1.
        max_deviation: largest standard deviation of its position, meters.
        near: a beam matches the map if it ends within this distance of an obstacle, meters.
        lost_below: share of matching beams below which the estimate is considered wrong.
    """

    min_weight: Scalar = 0.9
    max_deviation: Scalar = 0.5
    near: Scalar = 0.3
    lost_below: Scalar = 0.4

    def __check_init__(self):
        require_at_least_zero(self)


class AMCL(eqx.Module):
    """Monte-Carlo localization with an adaptive number of particles.

    Pass it to `jax.jit` as an argument: its floats are traced, its sizes static. The particle arrays have
    `max_particles` entries, the active particles first. A step works on the smallest of four set sizes that
    holds the active particles, and resampling grows the set by at most one size. Growing from 500 to 100 000
    particles, for example after a kidnapping, takes three steps.

    Attributes:
        map: the known map.
        prepared: look-up data of the sensor model on the map.
        bins: bins for counting particles.
        motion: p(x_t | x_{t−1}, u_t).
        sensor: p(z_t | x_t, m).
        skipping: exclusion of beams that hardly any particle explains.
        sampling: number of particles needed.
        recovery: share of random particles from the whole map.
        clustering: computes the estimate.
        agreement: thresholds for converged and lost.
        resample_below: the particles are resampled if the effective sample size is below this share of their
            number; over 1 resamples in every step.
        min_valid_beams: if fewer scored beams returned, the particles move by odometry alone.
        range_network: corrects the ranges of every scan first; None leaves them unchanged.
        max_particles: N (static).

    References:
        Yang et al. 2019; Fox 2003; Thrun, Burgard, Fox 2005, tables 8.2 and 8.3.
    """

    map: KnownMap
    prepared: Any
    bins: Bins
    motion: AbstractMotionModel
    sensor: AbstractSensorModel
    skipping: BeamSkipping
    sampling: KLDSampling
    recovery: Recovery
    clustering: Clustering
    agreement: Agreement
    resample_below: Scalar
    min_valid_beams: Scalar
    range_network: RangeNetwork | None = None
    max_particles: int = eqx.field(static=True, kw_only=True)

    def init(self, key: PRNGKeyArray, pose0: Float[Array, "3"], covariance: Float[Array, "3 3"]) -> AMCLState:
        """Return particles around a start pose (m, m, rad, world frame); zero covariance: all at the pose."""
        factor = cholesky(covariance.astype(jnp.float32), jnp.full(3, 1e-12, jnp.float32))
        offsets = jax.random.normal(key, (self.max_particles, 3), jnp.float32) @ factor.T
        poses = pose0.astype(jnp.float32)[None] + offsets
        return self._start(poses.at[:, 2].set(se2.wrap(poses[:, 2])))

    def init_global(self, key: PRNGKeyArray) -> AMCLState:
        """Return particles drawn uniformly over the free space."""
        return self._start(self.map.draw_free(key, self.max_particles))

    def _start(self, poses: Float[Array, "N 3"]) -> AMCLState:
        return AMCLState(
            poses=poses,
            log_weights=normalize(jnp.zeros(self.max_particles, jnp.float32)),
            num_particles=jnp.asarray(self.max_particles, jnp.int32),
            averages=Averages.none(),
            converged=jnp.asarray(False),
            num_steps=jnp.zeros((), jnp.int32),
        )

    def step(self, key: PRNGKeyArray, state: AMCLState, inputs: StepInputs) -> tuple[AMCLState, AMCLInfo]:
        """Move, weight and estimate, then resample as many particles as the belief needs."""
        inputs = with_corrected_ranges(self.range_network, inputs)
        sizes = self._sizes()
        stage = jnp.sum(state.num_particles > jnp.asarray(sizes[:-1], jnp.int32), dtype=jnp.int32)
        now_and_after = zip(sizes, sizes[1:] + sizes[-1:], strict=True)
        branches = [partial(self._step_of, now, after) for now, after in now_and_after]
        return jax.lax.switch(stage, branches, key, state, inputs)

    def _sizes(self) -> list[int]:
        """Return the compiled set sizes, ascending; the last is `max_particles`."""
        sizes = [self.max_particles]
        while len(sizes) < _NUM_STAGES and sizes[0] // _STAGE >= _SMALLEST:
            sizes.insert(0, sizes[0] // _STAGE)
        return sizes

    def _step_of(
        self, size: int, size_after: int, key: PRNGKeyArray, state: AMCLState, inputs: StepInputs
    ) -> tuple[AMCLState, AMCLInfo]:
        """Take a step with the first `size` particles; resampling returns up to `size_after`."""
        key_move, key_draw = jax.random.split(key)
        active = jnp.arange(size) < state.num_particles
        # (9), (12), (13)
        keys = jax.random.split(key_move, size)
        moved = jax.vmap(self.motion.sample, (0, 0, None))(keys, state.poses[:size], inputs.odometry)
        finite = jnp.all(jnp.isfinite(moved), axis=1, keepdims=True)
        moved = jnp.where(finite, moved, state.poses[:size])

        # (14)
        enough = self.sensor.num_scored(inputs.scan) >= self.min_valid_beams
        on_map = self.map.to_map(moved)
        scan = self.skipping.skip(
            self.map, inputs.scan, on_map, active, state.converged, self.sensor.max_beams
        )
        log_likelihood = self.sensor.log_prob_all(self.prepared, scan, on_map)
        log_likelihood = jnp.where(jnp.isfinite(log_likelihood), log_likelihood, -jnp.inf)
        before = state.log_weights[:size]
        after = jnp.where(active, before + log_likelihood, -jnp.inf)
        # A scan that is impossible at every particle cannot weight them.
        is_informative = enough & jnp.any(after > -jnp.inf)
        log_weights = normalize(jnp.where(is_informative, after, before))
        weights = jnp.exp(log_weights)

        bins = self.bins.index(self.map, moved)
        start = heaviest_particle(moved, weights, bins, self.bins.count)
        estimate = self.clustering.around(moved, weights, start)
        score = self._inlier_ratio(inputs.scan, estimate.mean)
        agreed = estimate.weight >= self.agreement.min_weight
        converged = agreed & (estimate.deviation <= self.agreement.max_deviation)
        misfit = enough & (score < self.agreement.lost_below)
        lost = converged & misfit
        mean_log_likelihood = jax.nn.logsumexp(after) / self.sensor.independent_count
        averages = self.recovery.update(state.averages, mean_log_likelihood, misfit)
        averages = jax.tree.map(partial(jnp.where, enough), averages, state.averages)

        # (15)
        num_particles = jnp.minimum(state.num_particles, size)
        ess = effective_sample_size(jnp.where(active, log_weights, -jnp.inf))
        random_share = jnp.where(enough, self.recovery.share(averages, lost), 0.0)
        is_due = ess < self.resample_below * num_particles.astype(jnp.float32)
        resampled = enough & (is_due | (random_share > 0.0))
        room = size_after - size
        num_next, next_poses, next_log_weights, num_random = jax.lax.cond(
            resampled,
            lambda: self._resample(key_draw, moved, log_weights, random_share, size_after),
            lambda: (
                num_particles,
                jnp.pad(moved, ((0, room), (0, 0))),
                jnp.pad(log_weights, (0, room)),
                jnp.int32(0),
            ),
        )
        next_log_weights = jnp.where(jnp.arange(size_after) < num_next, next_log_weights, -jnp.inf)
        state = AMCLState(
            poses=state.poses.at[:size_after].set(next_poses),
            log_weights=jnp.full_like(state.log_weights, -jnp.inf).at[:size_after].set(next_log_weights),
            num_particles=num_next,
            averages=averages,
            converged=converged & ~lost,
            num_steps=state.num_steps + 1,
        )
        all_finite = jnp.all(finite[:, 0] | ~active)
        few = jnp.where(enough, 0, Flag.FEW_VALID_BEAMS.value)
        nonfinite = jnp.where(all_finite, 0, Flag.NONFINITE_POSE.value)
        info = AMCLInfo(
            estimate=estimate,
            num_particles=num_particles,
            num_random=num_random,
            ess=ess,
            resampled=resampled,
            converged=converged,
            lost=lost,
            match_score=score,
            flags=(few | nonfinite).astype(jnp.int32),
        )
        return state, info

    def _inlier_ratio(self, scan: LidarScan, pose: Float[Array, "3"]) -> Float[Array, ""]:
        """Return the share of valid beams that end near an obstacle at a pose; NaN without a valid beam."""
        points, valid = end_points(scan)
        near = self.map.near_obstacles(self.agreement.near)
        inliers = near.sum_over_poses(self.map.to_map(pose[None]), points, jnp.ones(1, jnp.float32)) > 0.0
        return jnp.where(jnp.any(valid), inlier_ratio(inliers, valid), jnp.nan)

    def _resample(
        self,
        key: PRNGKeyArray,
        poses: Float[Array, "n 3"],
        log_weights: Float[Array, "n"],
        random_share: Float[Array, ""],
        count: int,
    ) -> tuple[Int[Array, ""], Float[Array, "count 3"], Float[Array, "count"], Int[Array, ""]]:
        """Draw as many particles as are needed, each independently, by weight or from the whole map.

        Return their number, poses and log-weights, and how many of them are from the whole map.
        """
        key_pick, key_which, key_random = jax.random.split(key, 3)
        cumulative = cumulative_weights(jnp.exp(log_weights))
        positions = jax.random.randint(key_pick, (count,), jnp.uint32(0), cumulative[-1], jnp.uint32)
        picked = poses[pick(cumulative, positions)]

        def mixed() -> tuple[Bool[Array, "count"], Float[Array, "count 3"]]:
            is_random = jax.random.uniform(key_which, (count,), jnp.float32) < random_share
            return is_random, jnp.where(is_random[:, None], self.map.draw_free(key_random, count), picked)

        # Rarely needed, and drawing them takes as long as the rest of the resampling.
        is_random, drawn = jax.lax.cond(random_share > 0.0, mixed, lambda: (jnp.zeros(count, bool), picked))
        bins = self.bins.index(self.map, drawn)
        num_needed = self.sampling.num_needed(bins, self.bins.count)
        num_random = jnp.sum(is_random & (jnp.arange(count) < num_needed), dtype=jnp.int32)
        uniform = jnp.full(count, -jnp.log(num_needed.astype(jnp.float32)))
        return num_needed, drawn, uniform, num_random
