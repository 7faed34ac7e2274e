"""Measures of a run in a known world that several experiments use."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float64, Int

from jaxslam import RBPF, RunResult
from jaxslam.core import se2
from jaxslam.grid import GridSpec
from jaxslam.metrics import BinaryMap, map_score
from jaxslam.sim import World, true_map

MARGIN = 17.0
"""Width of the maps' border around a world, meters: the window of a step may reach so far ahead."""
TOLERANCE = 0.1
"""A wall counts as found within this distance of the true wall, meters: two cells."""


def on_world_grid(slam: RBPF, world: World, margin: float = MARGIN) -> RBPF:
    """Return the filter with maps that cover the world: equal for all seeds, which share one compilation."""
    lower, upper = world.bounds()
    grid = GridSpec.covering(lower - margin, upper + margin, float(slam.grid.resolution))
    return dataclasses.replace(slam, grid=grid)


def mean_pose(
    particles: Float64[np.ndarray, "T N 3"], weights: Float64[np.ndarray, "T N"]
) -> Float64[np.ndarray, "T 3"]:
    """Return the weighted mean of the particles at each step; headings are averaged as directions."""
    position = np.sum(weights[..., None] * particles[..., :2], axis=1)
    sine, cosine = (np.sum(weights * part(particles[..., 2]), axis=1) for part in (np.sin, np.cos))
    return np.concatenate([position, np.arctan2(sine, cosine)[:, None]], axis=1)


def pose_errors(
    truth: Float64[np.ndarray, "T 3"], estimate: Float64[np.ndarray, "T 3"]
) -> tuple[Float64[np.ndarray, "T"], Float64[np.ndarray, "T"]]:
    """Return the error in position, meters, and the absolute error in heading, radians, at each step."""
    error = se2.relative(truth, estimate)
    return np.hypot(error[:, 0], error[:, 1]), np.abs(error[:, 2])


def of_first_seed(
    result: RunResult, truth: Float64[np.ndarray, "T 3"], times: Float64[np.ndarray, "_"]
) -> dict[str, np.ndarray]:
    """Return what the figures show of the first seed, see `stack_seeds`: map, paths, times of the curves."""
    return {
        "one_times": times,
        "one_map": result.log_odds,
        "one_resolution": np.asarray(result.grid.resolution, np.float64),
        "one_origin": np.asarray(result.grid.origin, np.float64),
        "one_path": result.trajectory,
        "one_truth": truth,
    }


def wall_and_free_iou(
    world: World, result: RunResult, inside: Float64[np.ndarray, "2"]
) -> tuple[float, float]:
    """Return the IoU of walls and of free space in the world's frame, without alignment."""
    grid = result.grid
    estimate = BinaryMap.from_log_odds(result.log_odds, grid.resolution, grid.origin)
    score = map_score(true_map(world, grid, inside), estimate, tolerance_m=TOLERANCE)
    return score.iou, score.free_iou or 0.0


def ancestors_left(
    ancestors: Int[np.ndarray, "T N"], resampled: Bool[np.ndarray, "T"], back: int
) -> Int[np.ndarray, "T"]:
    """Count the particles of `back` steps earlier that are ancestors of a particle at each step.

    Args:
        ancestors: `[T, N]` as in `StepInfo`.
        resampled: `[T]` true at the steps whose ancestors differ from 0 to N − 1.
        back: number of steps; fewer at the start of the run.
    """
    total, count = ancestors.shape
    left = np.empty(total, int)
    for step in range(total):
        slots = np.arange(count)
        for earlier in range(step, max(step - back, -1), -1):
            if resampled[earlier]:
                slots = np.unique(ancestors[earlier, slots])
        left[step] = len(np.unique(slots))
    return left
