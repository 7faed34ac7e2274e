"""One cell of the experiment: a method in a hall, over all seeds."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float64

from experiments.harness import Arrays, Cell
from experiments.tobacco_line.methods import ABLATION, COMPARED, EQUAL
from jaxslam.grid import GridSpec
from jaxslam.io import relative_poses
from jaxslam.metrics import BinaryMap, map_score
from jaxslam.preparation import Prepared, prepare
from jaxslam.report.folder import occupancy_probability
from jaxslam.run import RunResult, run_log
from jaxslam.sim import World, make_world, observable, simulate, to_log

METHODS = {**COMPARED, **ABLATION, **EQUAL}
MARGIN = 17.0
"""Of the maps around the hall, metres: as far as the window that a step works on may reach ahead."""
TOLERANCE = 0.1
"""A wall within two cells of the true one counts as found, metres."""
CLOUDS = (0.25, 0.5, 0.75)
"""When the particle cloud is kept, as shares of the drive."""


def run_cell(cell: Cell) -> Arrays:
    """All seeds of a cell. What varies over seeds has them first; maps and clouds are those of seed 0."""
    settings = cell.settings
    rows = [_run_seed(settings, seed) for seed in range(settings["seeds"])]
    stacked = {name: np.stack([row[name] for row in rows]) for name in rows[0] if not name.startswith("one_")}
    return stacked | {name: value for name, value in rows[0].items() if name.startswith("one_")}


def drive(world_name: str, seed: int, duration: float, method: str) -> tuple[World, Prepared, np.ndarray]:
    """A simulated drive made ready for a method, and the true poses at the processed scans `[T, 3]`."""
    world, waypoints = make_world(world_name)
    # Another key than the filter's, which knows nothing of the simulator's noise.
    key = jax.random.fold_in(jax.random.key(seed), 1)
    simulation = simulate(key, world, waypoints, duration=duration)
    prepared = prepare(to_log(simulation, world_name, in_world_frame=True), METHODS[method].configuration())
    # The same map for every seed, so that all share a compilation.
    points = np.asarray(world.segments, np.float64).reshape(-1, 2)
    grid = GridSpec.covering(
        points.min(axis=0) - MARGIN, points.max(axis=0) + MARGIN, float(prepared.slam.grid.resolution)
    )
    prepared = dataclasses.replace(prepared, slam=dataclasses.replace(prepared.slam, grid=grid))
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
    estimate = _mean_pose(particles, weights)
    error = relative_poses(truth, estimate)
    position, heading = np.hypot(error[:, 0], error[:, 1]), np.abs(error[:, 2])
    off = particles[..., :2] - truth[:, None, :2]
    around_truth = np.sqrt(np.sum(weights * np.sum(off * off, axis=-1), axis=1))
    about = particles[..., :2] - estimate[:, None, :2]
    spread = np.sqrt(np.sum(weights * np.sum(about * about, axis=-1), axis=1))
    times = np.arange(0.0, settings["duration"] + 1e-9, 1.0)
    score = _score(world, result, truth)
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
        "one_times": times,
        "one_map": result.log_odds,
        "one_resolution": np.asarray(result.grid.resolution, np.float64),
        "one_origin": np.asarray(result.grid.origin, np.float64),
        "one_path": result.trajectory,
        "one_truth": truth,
        "one_clouds": particles[kept],
        "one_cloud_truth": truth[kept],
    }


def time_methods(names: list[str], world: str, duration: float, rounds: int = 5) -> dict[str, float]:
    """Milliseconds per scan of each method, the median of rounds that take turns in one process."""
    ready = {name: drive(world, 0, duration, name)[1] for name in names}
    taken: dict[str, list[float]] = {name: [] for name in names}
    # The first round compiles.
    for _ in range(rounds + 1):
        for name, prepared in ready.items():
            taken[name].append(run_log(prepared.slam, jax.random.key(0), prepared.inputs).ms_per_scan)
    return {name: float(np.median(times[1:])) for name, times in taken.items()}


def _mean_pose(
    particles: Float64[np.ndarray, "T N 3"], weights: Float64[np.ndarray, "T N"]
) -> Float64[np.ndarray, "T 3"]:
    position = np.sum(weights[..., None] * particles[..., :2], axis=1)
    sine, cosine = (np.sum(weights * part(particles[..., 2]), axis=1) for part in (np.sin, np.cos))
    return np.concatenate([position, np.arctan2(sine, cosine)[:, None]], axis=1)


def _score(world: World, result: RunResult, truth: Float64[np.ndarray, "T 3"]) -> tuple[float, float]:
    """IoU of walls and of free space, in the world's frame: a map that is turned or shifted loses."""
    resolution, origin = float(result.grid.resolution), np.asarray(result.grid.origin, np.float64)
    occupied, free = observable(world, result.grid, jnp.asarray(truth[0, :2], jnp.float32))
    reference = BinaryMap(occupied, free, resolution, origin)
    estimate = BinaryMap.from_probability(occupancy_probability(result.log_odds), resolution, origin)
    score = map_score(reference, estimate, tolerance_m=TOLERANCE)
    return score.iou, score.free_iou or 0.0
