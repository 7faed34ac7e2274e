"""One cell of the localization part: tracking, global starts or kidnappings on one map."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float64, Int

from experiments._harness.harness import Arrays, Cell, stack_seeds
from experiments.coal_mine.mapping import drive, prepared
from jaxslam import LocalizationConfig, prepare_localization, run_log
from jaxslam.core.types import StepInputs
from jaxslam.io import OccupancyMap
from jaxslam.localization import AMCL, AMCLInfo
from jaxslam.pipeline.chunks import run_steps
from jaxslam.pipeline.run import occupancy_probability
from jaxslam.sim import true_map

CONFIGURATION = LocalizationConfig().with_lidar("vlp-16")
MAPPING = "optimised-15"
"""The method that builds the map."""
FOUND_WITHIN, FOUND_WITHIN_RADIANS = 0.5, np.deg2rad(10.0)
_CARRIED = 5.0
"""Smallest distance over which a robot is kidnapped, meters."""
_SETTLED = 10
"""Number of steps at the start that do not count for the tracking error."""


def run_cell(cell: Cell) -> Arrays:
    """Run all seeds of a cell: one drive per seed, and as many trials on it as `trials` says."""
    settings = cell.settings
    program = jax.jit(run_steps)
    return stack_seeds([_run_seed(settings, seed, program) for seed in range(settings["seeds"])])


def _run_seed(settings, seed: int, program) -> Arrays:
    log, driven = drive(settings["world"], seed, settings["duration"])
    # The built map comes from another drive.
    map = known_map(settings["world"], settings["duration"], settings["map"])
    amcl, scans = prepare_localization(log, map, CONFIGURATION)
    truth = driven.poses[scans.scan_index]
    rng, trials = np.random.default_rng(seed), []
    for trial in range(settings["trials"]):
        rows = choose_rows(settings["task"], truth, settings["before"], settings["steps"], rng)
        key = jax.random.fold_in(jax.random.key(seed), trial)
        inputs, true = _inputs_at(scans.inputs, rows), truth[rows]
        if settings["task"] == "global":
            state = jax.jit(AMCL.init_global)(amcl, key)
        else:
            covariance = jnp.diag(jnp.asarray([0.3, 0.3, 0.1], jnp.float32) ** 2)
            state = jax.jit(AMCL.init)(amcl, key, jnp.asarray(true[0], jnp.float32), covariance)
        _, infos = program(amcl, inputs, jax.random.fold_in(key, 1), state)
        carried_at = settings["before"] if settings["task"] == "kidnapped" else 0
        trials.append(_measured(infos, true, carried_at))
    if settings["task"] == "tracking":
        # The number of processed steps differs between drives, so the curves cannot be stacked.
        trials = [{**trial, "num_particles": np.median(trial["num_particles"])} for trial in trials]
        trials = [{name: trial[name] for name in trial if np.ndim(trial[name]) == 0} for trial in trials]
    return {name: np.stack([trial[name] for trial in trials]) for name in trials[0]}


@functools.cache
def known_map(world: str, duration: float, which: str) -> OccupancyMap:
    """Return the true map of a world, or the map that the optimized filter builds of it."""
    slam, scans, driven = prepared(MAPPING, world, 1000, duration)
    resolution = float(slam.grid.resolution)
    origin = np.append(np.asarray(slam.grid.origin, np.float64), 0.0)
    if which == "true":
        true = true_map(driven.world, slam.grid, driven.poses[0, :2])
        return OccupancyMap(true.occupied, true.free, true.resolution, origin)
    result = run_log(slam, scans, jax.random.key(0))
    probability = occupancy_probability(result.log_odds)
    return OccupancyMap(probability > 0.65, probability < 0.25, resolution, origin)


def choose_rows(
    task: str, truth: Float64[np.ndarray, "T 3"], before: int, steps: int, rng: np.random.Generator
) -> Int[np.ndarray, "_"]:
    """Return the indices of the steps of a drive that make up a trial.

    Args:
        task: "tracking": all steps; "global": `steps` consecutive steps from a random one; "kidnapped":
            `before` consecutive steps, then `steps` from another place.
        truth: `[T, 3]` true poses (m, m, rad).
        before: number of steps before the robot is kidnapped.
        steps: number of steps within which the robot should be found.
        rng: source of the random choices.
    """
    total = len(truth)
    if task == "tracking":
        return np.arange(total)
    if task == "global":
        return rng.integers(total - steps) + np.arange(steps)
    while True:
        first, then = rng.integers(total - before), rng.integers(total - steps)
        if np.hypot(*(truth[first + before - 1] - truth[then])[:2]) > _CARRIED:
            return np.r_[first : first + before, then : then + steps]


def _inputs_at(inputs: StepInputs, rows: Int[np.ndarray, "M"]) -> StepInputs:
    """Return the inputs of these steps, with zero odometry where a step does not follow its predecessor."""
    chosen = jax.tree.map(lambda leaf: leaf[rows], inputs)
    jumps = np.flatnonzero(np.diff(rows, prepend=-2) != 1)
    deltas = chosen.odometry.delta.at[jumps].set(jnp.zeros(3, jnp.float32))
    return eqx.tree_at(lambda i: i.odometry.delta, chosen, deltas)


def _measured(infos: AMCLInfo, truth: Float64[np.ndarray, "M 3"], since: int) -> Arrays:
    """Return the measures of a trial; updates until found are counted from step `since`."""
    estimate = np.asarray(infos.estimate.mean, np.float64)
    position = np.hypot(*(estimate - truth)[:, :2].T)
    turned = np.abs(np.angle(np.exp(1j * (estimate[:, 2] - truth[:, 2]))))
    at_place: Bool[np.ndarray, "M"] = (position < FOUND_WITHIN) & (turned < FOUND_WITHIN_RADIANS)
    known = (at_place & np.asarray(infos.converged & ~infos.lost))[since:]
    return {
        "position": position,
        "rmse": np.sqrt(np.mean(position[_SETTLED:] ** 2)),
        "worst": position[_SETTLED:].max(),
        "found": at_place[-1],
        # In updates; infinite if the robot is never found.
        "found_after": np.asarray(np.argmax(known) + 1.0 if known.any() else np.inf),
        "num_particles": np.asarray(infos.num_particles),
        "random": np.asarray(infos.num_random),
    }
