"""One cell of the mapping part: a method in the roadway, over all seeds."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float64

from experiments._harness.harness import Arrays, Cell, stack_seeds
from experiments._harness.measures import (
    ancestors_left,
    mean_pose,
    of_first_seed,
    on_world_grid,
    pose_errors,
    wall_and_free_iou,
)
from experiments.coal_mine.methods import MAPPED
from jaxslam import RBPF, RunResult, SensorLog, prepare, run_log, sim
from jaxslam.grid import cast, field_of_map
from jaxslam.pipeline.inputs import PreparedScans

NUM_BEAMS = 450
ANCESTRY = 50
"""Number of steps over which ancestors are traced back: about ten meters of the drive."""
_REACH = 6.0
"""Largest distance from the middle of the roadway at which a wall is searched for, meters."""


def drive(world: str, seed: int, duration: float) -> tuple[SensorLog, sim.Truth]:
    """Simulate a drive through the roadway; no filter uses its key, since steps and trials count from 0."""
    key = jax.random.fold_in(jax.random.key(seed), 2**32 - 2)
    return sim.drive(world, key=key, lidar=sim.vlp16_ring(num_beams=NUM_BEAMS), duration=duration)


def prepared(method: str, world: str, seed: int, duration: float) -> tuple[RBPF, PreparedScans, sim.Truth]:
    """Return a method's filter, the scans of a drive, and its truth."""
    log, truth = drive(world, seed, duration)
    slam, scans = prepare(log, MAPPED[method].configuration())
    return on_world_grid(slam, truth.world), scans, truth


def run_cell(cell: Cell) -> Arrays:
    """Run all seeds of a cell. Results have the seeds first; maps are of seed 0 only."""
    settings = cell.settings
    return stack_seeds([_run_seed(settings, seed) for seed in range(settings["seeds"])])


def _run_seed(settings, seed: int) -> Arrays:
    slam, scans, driven = prepared(settings["method"], settings["world"], seed, settings["duration"])
    world, truth = driven.world, driven.poses[scans.scan_index]
    result = run_log(slam, scans, jax.random.key(seed))
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
        **of_first_seed(result, truth, times),
    }


def length_error(path: Float64[np.ndarray, "T 3"], truth: Float64[np.ndarray, "T 3"]) -> float:
    """Return the error in the distance between both ends of the roadway along x, meters."""
    first, last = int(np.argmin(truth[:, 0])), int(np.argmax(truth[:, 0]))
    mapped, true = (np.linalg.norm(poses[last, :2] - poses[first, :2]) for poses in (path, truth))
    return float(abs(mapped - true))


def width_error(world: sim.World, result: RunResult, truth: Float64[np.ndarray, "T 3"]) -> float:
    """Return the median error of the roadway's width in the map, meters.

    At each pose, one ray is cast to the left and one to the right: in the final map from the estimated pose,
    and in the world from the true pose. A wall that was mapped twice makes the roadway narrower; a ray
    without a wall ends at `_REACH`. The median is robust against rays that graze the corner of a cross-cut,
    where an error of a centimeter in the pose changes the range by meters.
    """
    sides = jnp.asarray([-np.pi / 2, np.pi / 2], jnp.float32)
    true = np.asarray(jax.jit(sim.cast_rays)(world, jnp.asarray(truth, jnp.float32), sides))
    occupied = jnp.asarray(result.log_odds > 0)
    field = jax.jit(field_of_map, static_argnums=3)(occupied, result.grid.origin, result.grid.resolution, 10)
    poses = jnp.asarray(result.trajectory, jnp.float32)
    entered = np.asarray(jax.jit(jax.vmap(lambda pose: cast(field.fine, pose, sides, _REACH)))(poses))
    # A wall lies anywhere within its occupied cell, on average in the middle.
    found = np.minimum(entered + 0.5 * float(result.grid.resolution), _REACH)
    # Openings have no wall at the side.
    between_walls = (true < _REACH).all(axis=1)
    error = (found - true)[between_walls].sum(axis=1)
    return float(np.median(np.abs(error)))
