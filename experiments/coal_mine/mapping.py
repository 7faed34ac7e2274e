"""One cell of the mapping part: a method in the roadway, over all seeds."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float64

from experiments.coal_mine.methods import MAPPED
from experiments.harness import Arrays, Cell, stack_seeds
from experiments.measures import (
    ancestors_left,
    mean_pose,
    of_the_first_seed,
    on_the_worlds_grid,
    pose_errors,
    wall_and_free_iou,
)
from jaxslam.grid import field_of_map
from jaxslam.grid.raycast import cast
from jaxslam.pipeline.prepare import Prepared, prepare
from jaxslam.pipeline.run import RunResult, run_log
from jaxslam.sim import Simulation, World, cast_rays, make_world, simulate, to_log, vlp16_ring

NUM_BEAMS = 450
ANCESTRY = 50
"""Steps back over which the ancestors are counted: some ten metres."""
_REACH = 6.0
"""How far a wall is looked for from the middle of the roadway, metres."""


def drive(world_name: str, seed: int, duration: float) -> tuple[World, Simulation]:
    """A drive through the roadway, by a key that no filter has: theirs count steps and trials from 0."""
    world, waypoints = make_world(world_name)
    key = jax.random.fold_in(jax.random.key(seed), 2**32 - 2)
    return world, simulate(key, world, waypoints, lidar=vlp16_ring(num_beams=NUM_BEAMS), duration=duration)


def run_cell(cell: Cell) -> Arrays:
    """All seeds of a cell. What varies over seeds has them first; maps are those of seed 0."""
    settings = cell.settings
    return stack_seeds([_run_seed(settings, seed) for seed in range(settings["seeds"])])


def prepared_for(method: str, world_name: str, duration: float) -> Prepared:
    """The filter of a method and what it runs over, seed 0."""
    world, simulation = drive(world_name, 0, duration)
    return _prepared(method, world, simulation)


def _prepared(method: str, world: World, simulation: Simulation) -> Prepared:
    log = to_log(simulation, world.name, in_world_frame=True)
    return on_the_worlds_grid(prepare(log, MAPPED[method].configuration()), world)


def _run_seed(settings, seed: int) -> Arrays:
    world, simulation = drive(settings["world"], seed, settings["duration"])
    prepared = _prepared(settings["method"], world, simulation)
    truth = np.asarray(simulation.scan_poses, np.float64)[prepared.inputs.scan_index]
    result = run_log(prepared.slam, jax.random.key(seed), prepared.inputs)
    seconds = result.stamps - result.stamps[0]
    weights = np.exp(np.asarray(result.infos.log_weights))
    estimate = mean_pose(np.asarray(result.infos.poses, np.float64), weights)
    position, heading = pose_errors(truth, estimate)
    iou, free_iou = wall_and_free_iou(world, result, truth[0, :2])
    left = ancestors_left(np.asarray(result.infos.ancestors), result.resampled, ANCESTRY)
    times = np.arange(0.0, settings["duration"] + 1e-9, 1.0)
    return {
        "position": np.interp(times, seconds, position),
        "position_rmse": np.sqrt(np.mean(position**2)),
        "heading_rmse": np.sqrt(np.mean(heading**2)),
        "iou": np.asarray(iou),
        "free_iou": np.asarray(free_iou),
        "length_error": np.asarray(length_error(result.trajectory, truth)),
        "width_error": np.asarray(width_error(world, result, truth)),
        "ess": np.interp(times, seconds, result.ess / result.particles.shape[0]),
        "ancestors": np.interp(times, seconds, left),
        "least_ancestors": np.asarray(left[ANCESTRY:].min(initial=result.particles.shape[0])),
        "resamplings": np.asarray(result.resampled.sum()),
        **of_the_first_seed(result, truth, times),
    }


def length_error(path: Float64[np.ndarray, "T 3"], truth: Float64[np.ndarray, "T 3"]) -> float:
    """How much longer or shorter the map's roadway is, from its one end along x to the other, metres."""
    first, last = int(np.argmin(truth[:, 0])), int(np.argmax(truth[:, 0]))
    mapped, true = (np.linalg.norm(poses[last, :2] - poses[first, :2]) for poses in (path, truth))
    return float(abs(mapped - true))


def width_error(world: World, result: RunResult, truth: Float64[np.ndarray, "T 3"]) -> float:
    """Median error of the roadway's width in the map, metres.

    At every pose, to the left and to the right: in the final map from where the path has it, and in the
    world. A wall that was mapped twice makes the roadway narrow, one that is missing ends at `_REACH`. The
    median, because where a ray grazes the corner of a cross-cut a centimetre decides over metres: there a
    perfect map is as wrong as any.
    """
    sides = jnp.asarray([-np.pi / 2, np.pi / 2], jnp.float32)
    true = np.asarray(jax.jit(cast_rays)(world, jnp.asarray(truth, jnp.float32), sides))
    occupied = jnp.asarray(result.log_odds > 0)
    field = jax.jit(field_of_map, static_argnums=3)(occupied, result.grid.origin, result.grid.resolution, 10)
    poses = jnp.asarray(result.trajectory, jnp.float32)
    entered = np.asarray(jax.jit(jax.vmap(lambda pose: cast(field.fine, pose, sides, _REACH)))(poses))
    # The wall lies anywhere in the cell that it made occupied: in the middle, on average.
    found = np.minimum(entered + 0.5 * float(result.grid.resolution), _REACH)
    # Not in the openings, where there is no wall to the side.
    between_walls = (true < _REACH).all(axis=1)
    error = (found - true)[between_walls].sum(axis=1)
    return float(np.median(np.abs(error)))
