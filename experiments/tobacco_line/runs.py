"""One cell of the experiment: a method in a hall, over all seeds."""

import jax
import numpy as np
from jaxtyping import Float64

from experiments._harness.harness import Arrays, Cell, stack_seeds
from experiments._harness.measures import (
    mean_pose,
    of_first_seed,
    on_world_grid,
    pose_errors,
    wall_and_free_iou,
)
from experiments.tobacco_line.methods import ABLATION, COMPARED, EQUAL
from jaxslam import RBPF, prepare, run_log, sim
from jaxslam.pipeline.inputs import PreparedScans

METHODS = {**COMPARED, **ABLATION, **EQUAL}
CLOUDS = (0.25, 0.5, 0.75)
"""Times at which the particle cloud is kept, as fractions of the drive."""


def run_cell(cell: Cell) -> Arrays:
    """Run all seeds of a cell. Results have the seeds first; maps and clouds are of seed 0 only."""
    settings = cell.settings
    return stack_seeds([_run_seed(settings, seed) for seed in range(settings["seeds"])])


def prepared(
    world: str, seed: int, duration: float, method: str
) -> tuple[RBPF, PreparedScans, sim.Truth, Float64[np.ndarray, "T 3"]]:
    """Return a method's filter, the scans of a simulated drive, its truth, and the true poses `[T, 3]`."""
    # The key of the drive differs from the key of the filter, so that their random numbers are independent.
    log, truth = sim.drive(world, key=jax.random.fold_in(jax.random.key(seed), 1), duration=duration)
    slam, scans = prepare(log, METHODS[method].configuration())
    return on_world_grid(slam, truth.world), scans, truth, truth.poses[scans.scan_index]


def _run_seed(settings, seed: int) -> Arrays:
    slam, scans, truth, true_poses = prepared(
        settings["world"], seed, settings["duration"], settings["method"]
    )
    result = run_log(slam, scans, jax.random.key(seed))
    seconds = result.stamps - result.stamps[0]
    particles, weights = (
        np.asarray(result.infos.poses, np.float64),
        np.exp(np.asarray(result.infos.log_weights)),
    )
    # The estimate at each scan, not the final path: the weighted mean of the particles.
    estimate = mean_pose(particles, weights)
    position, heading = pose_errors(true_poses, estimate)
    off = particles[..., :2] - true_poses[:, None, :2]
    around_truth = np.sqrt(np.sum(weights * np.sum(off * off, axis=-1), axis=1))
    about = particles[..., :2] - estimate[:, None, :2]
    spread = np.sqrt(np.sum(weights * np.sum(about * about, axis=-1), axis=1))
    times = np.arange(0.0, settings["duration"] + 1e-9, 1.0)
    score = wall_and_free_iou(truth.world, result, true_poses[0, :2])
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
        **of_first_seed(result, true_poses, times),
        "one_clouds": particles[kept],
        "one_cloud_truth": true_poses[kept],
    }
