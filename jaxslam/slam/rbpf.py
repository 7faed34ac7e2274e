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
from jaxslam.core.types import StepInputs
from jaxslam.grid.occupancy import OccupancyModel
from jaxslam.grid.spec import GridSpec
from jaxslam.grid.window import copy_maps
from jaxslam.motion.base import AbstractMotionModel
from jaxslam.proposal.base import AbstractProposal, ProposalContext, ProposalResult
from jaxslam.range_network.network import RangeNetwork, with_corrected_ranges
from jaxslam.resampling._permute import keep_survivors_in_place
from jaxslam.resampling.adaptive import AdaptiveResampling
from jaxslam.resampling.ess import normalize
from jaxslam.sensor.base import AbstractSensorModel
from jaxslam.slam.view import MapView
from jaxslam.xla.materialize import compute_after
from jaxslam.xla.sharding import particle_mesh, with_sharding


class RBPFState(eqx.Module):
    """State of the filter between steps.

    Attributes:
        maps: `[N, H, W]` int8 log-odds in fixed point, one map per particle.
        poses: `[N, 3]` base poses (m, m, rad, world frame).
        log_weights: `[N]` normalized log-weights.
        num_steps: number of steps taken, int32.
    """

    maps: Int8[Array, "N H W"]
    poses: Float[Array, "N 3"]
    log_weights: Float[Array, "N"]
    num_steps: Int[Array, ""]


class StepInfo(eqx.Module):
    """Record of one step, small enough to be stacked over a long log, `[T, ...]`.

    Attributes:
        poses: `[N, 3]` after the proposal and before resampling.
        log_weights: `[N]` normalized, before resampling.
        ancestors: `[N]` int32, the particle that each slot continues.
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
    """Rao-Blackwellized particle filter on grid maps, Liang et al. (3)–(6).

    Pass it to `jax.jit` as an argument: its floats are traced, its sizes static.

    Attributes:
        grid: size and placement of the maps.
        motion: p(x_t | x_{t−1}, u_t).
        sensor: p(z_t | x_t, m).
        proposal: q, the distribution from which the new poses are drawn.
        resampling: when and how to resample.
        occupancy: what a scan adds to a map.
        usable_range: longer returns only clear the space up to this range, meters.
        range_network: corrects the ranges of every scan first; None leaves them unchanged.
        num_particles: N (static).
        window_size: side of the window that a step works on, cells, divisible by 4 (static). The window is
            centered on the lidar if the whole scan fits, else shifted ahead of it.
        radius: truncation radius of the distance field, cells (static).
        mesh: devices that the particles are sharded over (static); None: a single device. See `shard`.
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

    def shard(self, devices: Sequence[jax.Device]) -> "RBPF":
        """Return the same filter with its particles divided equally among devices.

        Raises:
            ValueError: the particles cannot be divided equally.
        """
        return dataclasses.replace(self, mesh=particle_mesh(self.num_particles, devices))

    @property
    def view(self) -> MapView:
        """Return the view of the maps that a step reads and writes."""
        return MapView(self.grid, self.occupancy, self.usable_range, self.window_size, self.radius)

    def init(self, key: PRNGKeyArray, pose0: Float[Array, "3"]) -> RBPFState:
        """Return all particles at `pose0` `[3]` with empty maps; the key is unused, as all start alike."""
        count = self.num_particles
        state = RBPFState(
            maps=jnp.zeros((count, self.grid.height, self.grid.width), jnp.int8),
            poses=jnp.tile(pose0.astype(jnp.float32)[None], (count, 1)),
            log_weights=normalize(jnp.zeros(count, jnp.float32)),
            num_steps=jnp.zeros((), jnp.int32),
        )
        return with_sharding(self.mesh, state, count)

    def step(self, key: PRNGKeyArray, state: RBPFState, inputs: StepInputs) -> tuple[RBPFState, StepInfo]:
        """Propose, weight, update the maps, and resample."""
        # All keys at once: each further split costs as much as drawing all the noise.
        keys = jax.random.split(key, self.num_particles + 1)
        inputs = with_corrected_ranges(self.range_network, inputs)
        heading = state.poses[jnp.argmax(state.log_weights), 2] + inputs.odometry.delta[2]
        view = self.view.look(inputs.scan, heading)
        predicted = jax.vmap(se2.compose, (0, None))(state.poses, inputs.odometry.delta)
        fields = self.view.fields(state.maps, predicted, view)
        context = ProposalContext(inputs.odometry, view.scan, fields, self.motion, self.sensor)
        proposed = self._propose(keys[:-1], state, predicted, context)
        log_weights = state.log_weights + proposed.log_likelihood + proposed.log_ratio
        finite = jnp.isfinite(log_weights)
        log_weights = normalize(jnp.where(finite, log_weights, -jnp.inf))
        # A proposal that does not read the maps would let XLA write them before it scores them. XLA then
        # keeps a copy of all maps: on 30 maps of 50 m that took as long as the whole step.
        poses = compute_after(proposed.log_likelihood, proposed.pose)
        maps, off_map = self.view.update(state.maps, poses, view, self.mesh)
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
        return with_sharding(self.mesh, state, self.num_particles), info

    def _propose(
        self,
        keys: Key[Array, "N"],
        state: RBPFState,
        predicted: Float[Array, "N 3"],
        context: ProposalContext,
    ) -> ProposalResult:
        proposed = self.proposal.sample_all(keys, state.poses, context)
        if not isinstance(proposed, ProposalResult):
            raise TypeError(
                f"{type(self.proposal).__name__}: sample must return a jaxslam.proposal.ProposalResult"
            )
        # Odometry that is not finite is ignored.
        predicted = jnp.where(_all_finite(predicted)[:, None], predicted, state.poses)
        finite = _all_finite(proposed.pose)
        # On the first step the map is empty and the start pose is given, so the particles are not spread.
        keep = (state.num_steps == 0) | ~finite
        # A particle that was reset to the odometry gets the lowest likelihood among the others.
        least = jnp.min(jnp.where(finite, proposed.log_likelihood, jnp.inf))
        least = jnp.where(jnp.isfinite(least), least, 0.0)
        flags = proposed.flags | jnp.where(finite, 0, Flag.NONFINITE_POSE.value)
        return ProposalResult(
            pose=jnp.where(keep[:, None], predicted, proposed.pose),
            log_likelihood=jnp.where(finite, proposed.log_likelihood, least),
            log_ratio=jnp.where(keep, 0.0, proposed.log_ratio),
            flags=flags.astype(jnp.int32),
        )


def _all_finite(poses: Float[Array, "N 3"]) -> Bool[Array, "N"]:
    return jnp.all(jnp.isfinite(poses), axis=1)


def _any_flag(flags: Int[Array, "N"]) -> Int[Array, ""]:
    # Bit by bit: JAX has no "or" reduction over particles that are sharded over devices.
    bits = jnp.asarray([flag.value for flag in Flag], jnp.int32)
    return jnp.sum(jnp.where(jnp.any(flags[:, None] & bits[None] != 0, axis=0), bits, 0), dtype=jnp.int32)


def trajectory(infos: StepInfo, particle: Int[Array, ""]) -> Float[Array, "T 3"]:
    """Return the poses `[T, 3]` of one surviving particle, traced back through its ancestors.

    Args:
        infos: stacked over time, leaves `[T, ...]`.
        particle: slot after the last step, as in `RBPFState`.
    """

    def back(slot: Int[Array, ""], info: StepInfo) -> tuple[Int[Array, ""], Float[Array, "3"]]:
        before = info.ancestors[slot]
        return before, info.poses[before]

    return jax.lax.scan(back, particle, infos, reverse=True)[1]
