"""The stages of a filter step, each as a function and the arguments that a running filter gives it."""

import jax
import jax.numpy as jnp

from jaxslam.core import se2
from jaxslam.core.types import StepInputs
from jaxslam.grid.field import prepare_field, window_rows
from jaxslam.grid.occupancy import add_scan, cells_from_lidar, quantize, range_table
from jaxslam.grid.walls import thin_walls
from jaxslam.grid.window import copy_maps, read_windows, window_origin, window_start, write_windows
from jaxslam.lidar.beams import scan_points
from jaxslam.matching.gauss_newton import GaussNewton, PosePrior
from jaxslam.matching.icp import ICP
from jaxslam.proposal.base import ProposalContext
from jaxslam.proposal.fruit_fly import FruitFlyProposal
from jaxslam.resampling._permute import keep_survivors_in_place
from jaxslam.resampling.adaptive import AdaptiveResampling
from jaxslam.slam import RBPF, RBPFState
from tests.benchmarks.programs import Program


def read(slam: RBPF, state: RBPFState, inputs: StepInputs) -> Program:
    shape = _field_shape(slam)
    return Program(
        lambda maps, starts: read_windows(maps, starts, shape), (state.maps, _starts(slam, state, shape))
    )


def distance_field(slam: RBPF, state: RBPFState, inputs: StepInputs) -> Program:
    shape = _field_shape(slam)
    starts = _starts(slam, state, shape)
    origins = jax.vmap(window_origin, (None, 0))(slam.grid, starts)

    def prepare(windows, origins, slam):
        windows = jax.vmap(thin_walls, (None, 0))(slam.occupancy, windows)
        return jax.vmap(prepare_field, (0, None, 0, None, None))(
            windows, quantize(slam.occupancy.occupied_above), origins, slam.grid.resolution, slam.radius
        )

    return Program(prepare, (read_windows(state.maps, starts, shape), origins, slam))


def match(slam: RBPF, state: RBPFState, inputs: StepInputs) -> Program:
    """One matcher with its default number of iterations, all beams, fine level."""

    def match_all(poses, fields, inputs, matcher, precision):
        ends = scan_points(inputs.scan)
        return jax.vmap(lambda pose, field: matcher.match(field, ends, pose, PosePrior(pose, precision)))(
            poses, fields.fine
        )

    precision = jnp.diag(jnp.asarray([400.0, 400.0, 4000.0], jnp.float32))
    return Program(match_all, (state.poses, _fields(slam, state, inputs), inputs, GaussNewton(), precision))


def icp(slam: RBPF, state: RBPFState, inputs: StepInputs) -> Program:
    """All beams, its default number of iterations on both levels."""

    def align_all(poses, fields, inputs, matcher):
        ends = scan_points(inputs.scan)
        return jax.vmap(lambda pose, field: matcher.match(field, ends, pose))(poses, fields)

    return Program(align_all, (state.poses, _fields(slam, state, inputs), inputs, ICP()))


def fruit_flies(slam: RBPF, state: RBPFState, inputs: StepInputs) -> Program:
    """The default swarm around every particle."""

    def fly_all(poses, fields, inputs, proposal, precision, key):
        beams = scan_points(inputs.scan, proposal.fly_beams)
        keys = jax.random.split(key, poses.shape[0])
        return jax.vmap(
            lambda key, pose, field: proposal.fly(key, field, beams, PosePrior(pose, precision), pose)
        )(keys, poses, fields.fine)

    precision = jnp.diag(jnp.asarray([400.0, 400.0, 4000.0], jnp.float32))
    fields = _fields(slam, state, inputs)
    return Program(fly_all, (state.poses, fields, inputs, FruitFlyProposal(), precision, jax.random.key(5)))


def propose(slam: RBPF, state: RBPFState, inputs: StepInputs) -> Program:
    """The whole default proposal, with all its matching."""

    def propose_all(poses, fields, inputs, slam, key):
        keys = jax.random.split(key, poses.shape[0])
        context = ProposalContext(inputs.odometry, inputs.scan, fields, slam.motion, slam.sensor)
        return slam.proposal.sample_all(keys, poses, context)

    return Program(propose_all, (state.poses, _fields(slam, state, inputs), inputs, slam, jax.random.key(2)))


def score(slam: RBPF, state: RBPFState, inputs: StepInputs) -> Program:
    def score_all(poses, fields, inputs, sensor):
        return jax.vmap(sensor.log_prob, (0, None, 0))(fields, inputs.scan, poses)

    return Program(score_all, (state.poses, _fields(slam, state, inputs), inputs, slam.sensor))


def integrate(slam: RBPF, state: RBPFState, inputs: StepInputs) -> Program:
    shape = (slam.window_size, slam.window_size)
    starts = _starts(slam, state, shape)

    def integrate_all(windows, poses, starts, inputs, slam):
        table = range_table(inputs.scan, slam.grid.resolution, 2 * slam.window_size)
        around = cells_from_lidar(slam.window_size, AROUND)
        ends = scan_points(inputs.scan)

        def one(window, pose, start):
            cells = jnp.floor(slam.grid.cells(se2.apply(pose, ends.points))).astype(jnp.int32)
            hits = cells[:, ::-1] - start[None]
            return add_scan(slam.occupancy, window, table, around, hits, ends.valid, pose[2])

        return jax.vmap(one)(windows, poses, starts)

    windows = read_windows(state.maps, starts, shape)
    return Program(integrate_all, (windows, state.poses, starts, inputs, slam))


def write(slam: RBPF, state: RBPFState, inputs: StepInputs) -> Program:
    shape = (slam.window_size, slam.window_size)
    starts = _starts(slam, state, shape)
    windows = read_windows(state.maps, starts, shape)
    return Program(write_windows, (jnp.copy(state.maps), windows, starts), in_place=True)


def resample(slam: RBPF, state: RBPFState, inputs: StepInputs) -> Program:
    """A step that does resample, with the copying of maps; most steps do not."""
    always = AdaptiveResampling(slam.resampling.scheme, threshold=2.0)

    def resample_all(maps, key, log_weights, always):
        return copy_maps(maps, keep_survivors_in_place(always(key, log_weights).ancestors))

    arguments = (jnp.copy(state.maps), jax.random.key(3), state.log_weights, always)
    return Program(resample_all, arguments, in_place=True)


def step(slam: RBPF, state: RBPFState, inputs: StepInputs) -> Program:
    """Everything. The state goes on from call to call, so the robot stands: else it would leave the map."""
    standing = jax.tree.map(jnp.zeros_like, inputs.odometry)
    inputs = StepInputs(standing, inputs.scan)

    def take(state, slam, key, inputs):
        return slam.step(jax.random.fold_in(key, state.num_steps), state, inputs)[0]

    return Program(take, (jax.tree.map(jnp.copy, state), slam, jax.random.key(4), inputs), in_place=True)


AROUND = jnp.zeros(2, jnp.int32)
"""The window in the middle, as for a lidar that sees no farther."""

STAGES = {
    "read windows": read,
    "distance field": distance_field,
    "match": match,
    "icp": icp,
    "fruit flies": fruit_flies,
    "propose": propose,
    "score": score,
    "integrate scan": integrate,
    "write windows": write,
    "resample": resample,
    "step": step,
}


def _field_shape(slam: RBPF) -> tuple[int, int]:
    return window_rows(slam.window_size, slam.radius), slam.window_size


def _starts(slam: RBPF, state: RBPFState, shape: tuple[int, int]) -> jax.Array:
    return jax.vmap(lambda pose: window_start(slam.grid, pose[:2], shape, AROUND)[0])(state.poses)


def _fields(slam: RBPF, state: RBPFState, inputs: StepInputs):
    stage = distance_field(slam, state, inputs)
    return jax.jit(stage.function)(*stage.arguments)
