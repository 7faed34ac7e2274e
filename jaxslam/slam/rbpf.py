"""The Rao-Blackwellized particle filter: a trajectory and a map per particle."""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.sharding import Mesh
from jaxtyping import Array, Bool, Float, Int, Int8, Key, PRNGKeyArray

from jaxslam.core import se2
from jaxslam.core.flags import Flag
from jaxslam.core.types import LidarScan, StepInputs
from jaxslam.grid.field import Field, prepare_field, window_rows
from jaxslam.grid.occupancy import OccupancyModel, add_scan, cells_from_lidar, quantise, range_table
from jaxslam.grid.spec import GridSpec
from jaxslam.grid.walls import outstanding
from jaxslam.grid.window import (
    copy_maps,
    inside_window,
    read_windows,
    shift_to_scan,
    window_origin,
    window_start,
    write_windows,
)
from jaxslam.lidar.beams import scan_points
from jaxslam.motion.base import AbstractMotionModel
from jaxslam.proposal.base import AbstractProposal, Proposed
from jaxslam.range_network.network import RangeNetwork, with_corrected_ranges
from jaxslam.resampling._permute import keep_survivors_in_place
from jaxslam.resampling.adaptive import AdaptiveResampling
from jaxslam.resampling.ess import normalise
from jaxslam.sensor.base import AbstractSensorModel
from jaxslam.xla.materialise import computed_once
from jaxslam.xla.sharding import particle_mesh, shared_out


class RBPFState(eqx.Module):
    """What the next step needs.

    Attributes:
        maps: `[N, H, W]` int8 log-odds in fixed point, one map per particle.
        poses: `[N, 3]` base poses (m, m, rad, world frame).
        log_weights: `[N]` normalised log-weights.
        num_steps: steps taken, int32.
    """

    maps: Int8[Array, "N H W"]
    poses: Float[Array, "N 3"]
    log_weights: Float[Array, "N"]
    num_steps: Int[Array, ""]


class StepInfo(eqx.Module):
    """What one step leaves for the record; all small, so that it can be stacked over a long log, `[T, ...]`.

    Attributes:
        poses: `[N, 3]` after the proposal and before resampling.
        log_weights: `[N]` normalised, before resampling.
        ancestors: `[N]` int32, the particle that each slot goes on from.
        ess: effective sample size before resampling, 1 to N.
        resampled: whether the particles were resampled.
        flags: `jaxslam.core.flags.Flag` bits of the whole step, int32.
    """

    poses: Float[Array, "*T N 3"]
    log_weights: Float[Array, "*T N"]
    ancestors: Int[Array, "*T N"]
    ess: Float[Array, "*T"]
    resampled: Bool[Array, "*T"]
    flags: Int[Array, "*T"]


class RBPF(eqx.Module):
    """Rao-Blackwellized particle filter on grid maps, tobacco (3)–(6).

    Pass it to `jax.jit` as an argument: its floats are traced, its sizes static.

    Attributes:
        grid: size and place of the maps.
        motion: p(x_t | x_{t−1}, u_t).
        sensor: p(z_t | x_t, m).
        proposal: q, where the particles go.
        resampling: when and how to resample.
        occupancy: what a scan adds to a map.
        usable_range: longer returns only clear the space before them, metres.
        range_network: corrects the ranges of every scan first; None leaves them as they are.
        num_particles: N (static).
        window_size: cells along a side of the window that a step works on, divisible by 4 (static): around
            the lidar where that holds all it sees, else ahead of it.
        radius: truncation of the distance field, cells (static).
        mesh: devices that the particles are spread over (static); None: all on one. See `spread_over`.
    """

    grid: GridSpec
    motion: AbstractMotionModel
    sensor: AbstractSensorModel
    proposal: AbstractProposal
    resampling: AdaptiveResampling
    occupancy: OccupancyModel
    usable_range: float | Float[Array, ""]
    range_network: RangeNetwork | None = None
    num_particles: int = eqx.field(static=True, kw_only=True)
    window_size: int = eqx.field(static=True, kw_only=True)
    radius: int = eqx.field(static=True, default=6)
    mesh: Mesh | None = eqx.field(static=True, default=None)

    def spread_over(self, devices: Sequence[jax.Device]) -> "RBPF":
        """The same filter with an equal share of its particles on each device, for one with many.

        Raises:
            ValueError: the particles cannot be shared out equally.
        """
        return dataclasses.replace(self, mesh=particle_mesh(self.num_particles, devices))

    def init(self, key: PRNGKeyArray, pose0: Float[Array, "3"]) -> RBPFState:
        """All particles at `pose0` `[3]` with empty maps; the key is for models that spread them."""
        count = self.num_particles
        state = RBPFState(
            maps=jnp.zeros((count, self.grid.height, self.grid.width), jnp.int8),
            poses=jnp.tile(pose0.astype(jnp.float32)[None], (count, 1)),
            log_weights=normalise(jnp.zeros(count, jnp.float32)),
            num_steps=jnp.zeros((), jnp.int32),
        )
        return shared_out(self.mesh, state, count)

    def blank_infos(self, num_steps: int) -> StepInfo:
        """Room for the infos of so many steps, stacked over time; zeros."""
        rows = (num_steps, self.num_particles)
        return StepInfo(
            poses=jnp.zeros((*rows, 3), jnp.float32),
            log_weights=jnp.zeros(rows, jnp.float32),
            ancestors=jnp.zeros(rows, jnp.int32),
            ess=jnp.zeros(num_steps, jnp.float32),
            resampled=jnp.zeros(num_steps, bool),
            flags=jnp.zeros(num_steps, jnp.int32),
        )

    def step(self, key: PRNGKeyArray, state: RBPFState, inputs: StepInputs) -> tuple[RBPFState, StepInfo]:
        """Propose, weigh, update the maps, resample."""
        # All at once: each further split costs as much as drawing all the noise.
        keys = jax.random.split(key, self.num_particles + 1)
        inputs = with_corrected_ranges(self.range_network, inputs)
        shift, clearing, scan = self._view(state, inputs)
        inputs = eqx.tree_at(lambda i: i.scan, inputs, scan)

        fields = self._fields(state, inputs, shift)
        proposed = self._propose(keys[:-1], state, inputs, fields)
        log_weights = state.log_weights + proposed.log_likelihood + proposed.log_ratio
        finite = jnp.isfinite(log_weights)
        log_weights = normalise(jnp.where(finite, log_weights, -jnp.inf))
        poses = _after(proposed.log_likelihood, proposed.pose)
        maps, off_map = self._update_maps(state.maps, poses, scan, clearing, shift)
        resampling = self.resampling(keys[-1], log_weights)
        ancestors = keep_survivors_in_place(resampling.ancestors)

        flags = (
            _any_flag(proposed.flags)
            | jnp.where(jnp.any(off_map), Flag.OFF_MAP.value, 0)
            | jnp.where(jnp.all(finite), 0, Flag.NONFINITE_WEIGHT.value)
        )
        state = RBPFState(
            maps=copy_maps(maps, ancestors, self.mesh),
            poses=proposed.pose[ancestors],
            log_weights=resampling.log_weights,
            num_steps=state.num_steps + 1,
        )
        info = StepInfo(
            poses=proposed.pose,
            log_weights=log_weights,
            ancestors=ancestors,
            ess=resampling.ess,
            resampled=resampling.resampled,
            flags=flags.astype(jnp.int32),
        )
        return shared_out(self.mesh, state, self.num_particles), info

    def _view(self, state: RBPFState, inputs: StepInputs) -> tuple[Int[Array, "2"], LidarScan, LidarScan]:
        """Where the windows lie from the lidar, and the scan twice.

        Returns:
            Rows and columns from the lidar to the windows' centre; the scan with the returns beyond the
            usable range moved to it, which clear space up to there; and the scan without those returns and
            without those off the windows: what is matched, weighed and mapped.
        """
        scan = inputs.scan
        reach = jnp.asarray(self.usable_range, jnp.float32)
        clearing = eqx.tree_at(lambda s: s.ranges, scan, jnp.minimum(scan.ranges, reach))
        # One view for all particles: their headings differ by little.
        best = state.poses[jnp.argmax(state.log_weights)]
        heading = best[2] + inputs.odometry.delta[2] + scan.pose_base_lidar[2]
        bearings = scan.angles() + jnp.where(jnp.isfinite(heading), heading, 0.0)
        ends = clearing.ranges[:, None] * jnp.stack([jnp.cos(bearings), jnp.sin(bearings)], axis=-1)
        ends = jnp.where(scan.valid[:, None], ends, 0.0)
        shift = shift_to_scan(ends, self.grid.resolution, self.window_size)
        seen = scan.valid & (scan.ranges < reach)
        seen = seen & inside_window(ends, self.grid.resolution, self.window_size, shift)
        return shift, clearing, eqx.tree_at(lambda s: s.valid, scan, seen)

    def _fields(self, state: RBPFState, inputs: StepInputs, shift: Int[Array, "2"]) -> Field:
        """Each particle's map around what its lidar sees from where the odometry alone puts it, prepared."""
        shape = (window_rows(self.window_size, self.radius), self.window_size)

        def start(pose: Float[Array, "3"]) -> Int[Array, "2"]:
            predicted = se2.compose(pose, inputs.odometry.delta)
            lidar = se2.compose(predicted, inputs.scan.pose_base_lidar)
            return window_start(self.grid, lidar[:2], shape, shift)[0]

        starts = jax.vmap(start)(state.poses)
        windows = jax.vmap(outstanding, (None, 0))(self.occupancy, read_windows(state.maps, starts, shape))
        origins = jax.vmap(window_origin, (None, 0))(self.grid, starts)
        threshold = quantise(self.occupancy.occupied_above)
        return jax.vmap(prepare_field, (0, None, 0, None, None))(
            windows, threshold, origins, self.grid.resolution, self.radius
        )

    def _propose(
        self, keys: Key[Array, "N"], state: RBPFState, inputs: StepInputs, fields: Field
    ) -> Proposed:
        proposed = self.proposal.sample_all(keys, state.poses, inputs, fields, self.motion, self.sensor)
        predicted = jax.vmap(se2.compose, (0, None))(state.poses, inputs.odometry.delta)
        # Odometry that is not a number moves nothing.
        predicted = jnp.where(_all_finite(predicted), predicted, state.poses)
        finite = _all_finite(proposed.pose)
        # An empty map has nothing to say, and the start pose is given: the first step does not scatter it.
        keep = (state.num_steps == 0) | ~finite
        poses = jnp.where(keep, predicted, proposed.pose)
        flags = proposed.flags | jnp.where(finite[:, 0], 0, Flag.NONFINITE_POSE.value)
        # One that was put back to the odometry counts as the least likely of the others.
        least = jnp.min(jnp.where(finite[:, 0], proposed.log_likelihood, jnp.inf))
        least = jnp.where(jnp.isfinite(least), least, 0.0)
        log_likelihood = jnp.where(finite[:, 0], proposed.log_likelihood, least)
        log_ratio = jnp.where(keep[:, 0], 0.0, proposed.log_ratio)
        return eqx.tree_at(
            lambda p: (p.pose, p.log_likelihood, p.log_ratio, p.flags),
            proposed,
            (poses, log_likelihood, log_ratio, flags.astype(jnp.int32)),
        )

    def _update_maps(
        self,
        maps: Int8[Array, "N H W"],
        poses: Float[Array, "N 3"],
        scan: LidarScan,
        clearing: LidarScan,
        shift: Int[Array, "2"],
    ) -> tuple[Int8[Array, "N H W"], Bool[Array, "N"]]:
        shape = (self.window_size, self.window_size)
        table = range_table(clearing, self.grid.resolution, 2 * self.window_size)
        around = cells_from_lidar(self.window_size, shift)
        ends = scan_points(scan)
        # The heading of a particle would otherwise be computed again for each cell of its window.
        poses = computed_once(lambda poses: poses + 0.0, poses)
        lidar = jax.vmap(se2.compose, (0, None))(poses, scan.pose_base_lidar)
        starts, off_map = jax.vmap(lambda pose: window_start(self.grid, pose[:2], shape, shift))(lidar)

        def update(
            window: Int8[Array, "S S"],
            start: Int[Array, "2"],
            pose: Float[Array, "3"],
            heading: Float[Array, ""],
        ) -> Int8[Array, "S S"]:
            cells = jnp.floor(self.grid.cells(se2.apply(pose, ends.points))).astype(jnp.int32)
            return add_scan(
                self.occupancy, window, table, around, cells[:, ::-1] - start[None], ends.valid, heading
            )

        windows = read_windows(maps, starts, shape)
        windows = jax.vmap(update)(windows, starts, poses, lidar[:, 2])
        return write_windows(maps, windows, starts, self.mesh), off_map


def _after(log_likelihood: Float[Array, "N"], poses: Float[Array, "N 3"]) -> Float[Array, "N 3"]:
    """The poses, known only when the likelihoods are.

    A proposal that does not look at the maps would let XLA write them first and score them afterwards, for
    which it keeps a copy of all of them: on 30 maps of 50 m that took as long as the whole step.
    """
    # No number is both, which the compiler does not know.
    never = (log_likelihood > 1.0) & (log_likelihood < 1.0)
    return poses + never.astype(jnp.float32)[:, None]


def _all_finite(poses: Float[Array, "N 3"]) -> Bool[Array, "N 1"]:
    return jnp.all(jnp.isfinite(poses), axis=1, keepdims=True)


def _any_flag(flags: Int[Array, "N"]) -> Int[Array, ""]:
    # Bit by bit: particles that are spread over devices have no common "or".
    bits = jnp.asarray([flag.value for flag in Flag], jnp.int32)
    return jnp.sum(jnp.where(jnp.any(flags[:, None] & bits[None] != 0, axis=0), bits, 0), dtype=jnp.int32)


def trajectory(infos: StepInfo, particle: Int[Array, ""]) -> Float[Array, "T 3"]:
    """Poses `[T, 3]` of one surviving particle, read back through the ancestors.

    Args:
        infos: stacked over time, leaves `[T, ...]`.
        particle: slot after the last step, as in `RBPFState`.
    """

    def back(slot: Int[Array, ""], info: StepInfo) -> tuple[Int[Array, ""], Float[Array, "3"]]:
        before = info.ancestors[slot]
        return before, info.poses[before]

    return jax.lax.scan(back, particle, infos, reverse=True)[1]
