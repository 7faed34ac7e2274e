"""Measures that several experiments take of a run in a known world."""

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float64, Int

from jaxslam.core import se2
from jaxslam.grid import GridSpec
from jaxslam.metrics import BinaryMap, map_score
from jaxslam.pipeline.prepare import Prepared
from jaxslam.pipeline.run import RunResult
from jaxslam.report.folder import occupancy_probability
from jaxslam.sim import World, observable

MARGIN = 17.0
"""Of the maps around a world, metres: as far as the window that a step works on may reach ahead."""
TOLERANCE = 0.1
"""A wall within two cells of the true one counts as found, metres."""


def on_the_worlds_grid(prepared: Prepared, world: World, margin: float = MARGIN) -> Prepared:
    """The same with maps that lie round the world: equal for every seed, so that all share a compilation."""
    lower, upper = world.bounds()
    grid = GridSpec.covering(lower - margin, upper + margin, float(prepared.slam.grid.resolution))
    return dataclasses.replace(prepared, slam=dataclasses.replace(prepared.slam, grid=grid))


def mean_pose(
    particles: Float64[np.ndarray, "T N 3"], weights: Float64[np.ndarray, "T N"]
) -> Float64[np.ndarray, "T 3"]:
    """Weighted mean of the particles at every step; headings as directions."""
    position = np.sum(weights[..., None] * particles[..., :2], axis=1)
    sine, cosine = (np.sum(weights * part(particles[..., 2]), axis=1) for part in (np.sin, np.cos))
    return np.concatenate([position, np.arctan2(sine, cosine)[:, None]], axis=1)


def pose_errors(
    truth: Float64[np.ndarray, "T 3"], estimate: Float64[np.ndarray, "T 3"]
) -> tuple[Float64[np.ndarray, "T"], Float64[np.ndarray, "T"]]:
    """How far an estimate is off at every step, metres, and how much it is turned, radians."""
    error = se2.relative(truth, estimate)
    return np.hypot(error[:, 0], error[:, 1]), np.abs(error[:, 2])


def of_the_first_seed(
    result: RunResult, truth: Float64[np.ndarray, "T 3"], times: Float64[np.ndarray, "_"]
) -> dict[str, np.ndarray]:
    """What the pictures show, see `stack_seeds`: a map with its path, and the times of the curves."""
    return {
        "one_times": times,
        "one_map": result.log_odds,
        "one_resolution": np.asarray(result.grid.resolution, np.float64),
        "one_origin": np.asarray(result.grid.origin, np.float64),
        "one_path": result.trajectory,
        "one_truth": truth,
    }


def true_map(world: World, grid: GridSpec, inside: Float64[np.ndarray, "2"]) -> BinaryMap:
    """What a robot that starts `inside` (m) can see of a world, on the cells of a grid."""
    occupied, free = observable(world, grid, jnp.asarray(inside, jnp.float32))
    return BinaryMap(occupied, free, float(grid.resolution), np.asarray(grid.origin, np.float64))


def wall_and_free_iou(
    world: World, result: RunResult, inside: Float64[np.ndarray, "2"]
) -> tuple[float, float]:
    """IoU of walls and of free space, in the world's frame: a map that is turned or shifted loses."""
    resolution, origin = float(result.grid.resolution), np.asarray(result.grid.origin, np.float64)
    estimate = BinaryMap.from_probability(occupancy_probability(result.log_odds), resolution, origin)
    score = map_score(true_map(world, result.grid, inside), estimate, tolerance_m=TOLERANCE)
    return score.iou, score.free_iou or 0.0


def ancestors_left(
    ancestors: Int[np.ndarray, "T N"], resampled: Bool[np.ndarray, "T"], back: int
) -> Int[np.ndarray, "T"]:
    """How many of the particles of `back` steps ago the present ones descend from, at every step.

    Args:
        ancestors: `[T, N]` as in `StepInfo`.
        resampled: `[T]` where they are not simply 0 to N − 1.
        back: steps; at the first steps, all there are.
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
