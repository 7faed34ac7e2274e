"""One cell of the experiment: a method in a hall, over all seeds."""

import jax
import numpy as np

from experiments.harness import Arrays, Cell, stack_seeds
from experiments.measures import (
    mean_pose,
    of_the_first_seed,
    on_the_worlds_grid,
    pose_errors,
    wall_and_free_iou,
)
from experiments.tobacco_line.methods import ABLATION, COMPARED, EQUAL
from jaxslam.pipeline.prepare import Prepared, prepare
from jaxslam.pipeline.run import run_log
from jaxslam.sim import World, make_world, simulate, to_log

METHODS = {**COMPARED, **ABLATION, **EQUAL}
CLOUDS = (0.25, 0.5, 0.75)
"""When the particle cloud is kept, as shares of the drive."""


def run_cell(cell: Cell) -> Arrays:
    """All seeds of a cell. What varies over seeds has them first; maps and clouds are those of seed 0."""
    settings = cell.settings
    return stack_seeds([_run_seed(settings, seed) for seed in range(settings["seeds"])])


def drive(world_name: str, seed: int, duration: float, method: str) -> tuple[World, Prepared, np.ndarray]:
    """A simulated drive made ready for a method, and the true poses at the processed scans `[T, 3]`."""
    world, waypoints = make_world(world_name)
    # Another key than the filter's, which knows nothing of the simulator's noise.
    key = jax.random.fold_in(jax.random.key(seed), 1)
    simulation = simulate(key, world, waypoints, duration=duration)
    prepared = prepare(to_log(simulation, world_name, in_world_frame=True), METHODS[method].configuration())
    prepared = on_the_worlds_grid(prepared, world)
    truth = np.asarray(simulation.scan_poses, np.float64)[prepared.inputs.scan_index]
    return world, prepared, truth


def _run_seed(settings, seed: int) -> Arrays:
    world, prepared, truth = drive(settings["world"], seed, settings["duration"], settings["method"])
    result = run_log(prepared.slam, jax.random.key(seed), prepared.inputs)
    seconds = result.stamps - result.stamps[0]
    particles, weights = (
        np.asarray(result.infos.poses, np.float64),
        np.exp(np.asarray(result.infos.log_weights)),
    )
    # What the filter says at each scan, not what it knows in hindsight: the weighted mean of the particles.
    estimate = mean_pose(particles, weights)
    position, heading = pose_errors(truth, estimate)
    off = particles[..., :2] - truth[:, None, :2]
    around_truth = np.sqrt(np.sum(weights * np.sum(off * off, axis=-1), axis=1))
    about = particles[..., :2] - estimate[:, None, :2]
    spread = np.sqrt(np.sum(weights * np.sum(about * about, axis=-1), axis=1))
    times = np.arange(0.0, settings["duration"] + 1e-9, 1.0)
    score = wall_and_free_iou(world, result, truth[0, :2])
    kept = [int(share * (len(seconds) - 1)) for share in CLOUDS]
    return {
        "position": np.interp(times, seconds, position),
        "heading": np.interp(times, seconds, heading),
        "position_rmse": np.sqrt(np.mean(position**2)),
        "heading_rmse": np.sqrt(np.mean(heading**2)),
        "around_truth": np.sqrt(np.mean(around_truth**2)),
        "spread": np.sqrt(np.mean(spread**2)),
        "iou": np.asarray(score[0]),
        "free_iou": np.asarray(score[1]),
        "resamplings": np.asarray(result.resampled.sum()),
        **of_the_first_seed(result, truth, times),
        "one_clouds": particles[kept],
        "one_cloud_truth": truth[kept],
    }
