"""One cell of the localisation part: tracking, global starts or kidnappings in one map."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float64, Int

from experiments.coal_mine.mapping import drive
from experiments.coal_mine.methods import MAPPED
from experiments.harness import Arrays, Cell, stack_seeds
from experiments.measures import on_the_worlds_grid, true_map
from jaxslam.config.lidar_presets import PRESETS
from jaxslam.config.localization import LocalizationConfig
from jaxslam.core.types import StepInputs
from jaxslam.io import OccupancyMap
from jaxslam.localization import AMCL, AMCLInfo, run
from jaxslam.pipeline.build import build_localizer
from jaxslam.pipeline.inputs import pair_scans
from jaxslam.pipeline.prepare import prepare
from jaxslam.pipeline.run import run_log
from jaxslam.preprocess.ranges import correct_scans
from jaxslam.report.folder import occupancy_probability
from jaxslam.sim import to_log

CONFIGURATION = LocalizationConfig().with_lidar(PRESETS["vlp-16"])
MAPPING = MAPPED["optimised-15"]
"""What builds the map."""
FOUND_WITHIN, FOUND_WITHIN_RADIANS = 0.5, np.deg2rad(10.0)
_CARRIED = 5.0
"""How far at least, metres."""
_SETTLED = 10
"""Steps from which on tracking errors count."""


def run_cell(cell: Cell) -> Arrays:
    """All seeds of a cell, one drive each with as many trials as `trials` says."""
    settings = cell.settings
    step = jax.jit(run)
    return stack_seeds([_run_seed(settings, seed, step) for seed in range(settings["seeds"])])


def _run_seed(settings, seed: int, run_program) -> Arrays:
    _, simulation = drive(settings["world"], seed, settings["duration"])
    log = to_log(simulation, settings["world"], in_world_frame=True)
    corrected, _ = correct_scans(log, CONFIGURATION.lidar)
    prepared = pair_scans(corrected, CONFIGURATION.thinning)
    truth = np.asarray(simulation.scan_poses, np.float64)[prepared.scan_index]
    # The built map is that of another drive, which is over.
    amcl = build_localizer(CONFIGURATION, known_map(settings["world"], settings["duration"], settings["map"]))
    rng, trials = np.random.default_rng(seed), []
    for trial in range(settings["trials"]):
        rows = choose_rows(settings["task"], truth, settings["before"], settings["steps"], rng)
        key = jax.random.fold_in(jax.random.key(seed), trial)
        inputs, true = _inputs_at(prepared.inputs, rows), truth[rows]
        if settings["task"] == "global":
            state = jax.jit(AMCL.init_global)(amcl, key)
        else:
            covariance = jnp.diag(jnp.asarray([0.3, 0.3, 0.1], jnp.float32) ** 2)
            state = jax.jit(AMCL.init)(amcl, key, jnp.asarray(true[0], jnp.float32), covariance)
        _, infos = run_program(amcl, jax.random.fold_in(key, 1), state, inputs)
        carried_at = settings["before"] if settings["task"] == "kidnapped" else 0
        trials.append(_measured(infos, true, carried_at))
    if settings["task"] == "tracking":
        # Drives are processed in more or fewer steps.
        trials = [{**trial, "live": np.median(trial["live"])} for trial in trials]
        trials = [{name: trial[name] for name in trial if np.ndim(trial[name]) == 0} for trial in trials]
    return {name: np.stack([trial[name] for trial in trials]) for name in trials[0]}


@functools.cache
def known_map(world_name: str, duration: float, which: str) -> OccupancyMap:
    """The true map of a world, or the one that the optimised filter builds of it."""
    world, simulation = drive(world_name, 1000, duration)
    log = to_log(simulation, in_world_frame=True)
    prepared = on_the_worlds_grid(prepare(log, MAPPING.configuration()), world)
    grid = prepared.slam.grid
    origin = np.append(np.asarray(grid.origin, np.float64), 0.0)
    if which == "true":
        true = true_map(world, grid, np.asarray(simulation.scan_poses[0, :2], np.float64))
        return OccupancyMap(true.occupied, true.free, true.resolution, origin)
    result = run_log(prepared.slam, jax.random.key(0), prepared.inputs)
    probability = occupancy_probability(result.log_odds)
    return OccupancyMap(probability > 0.65, probability < 0.25, float(grid.resolution), origin)


def choose_rows(
    task: str, truth: Float64[np.ndarray, "T 3"], before: int, steps: int, rng: np.random.Generator
) -> Int[np.ndarray, "_"]:
    """Which steps of a drive a trial is made of.

    Args:
        task: "tracking": all of them; "global": `steps` from anywhere; "kidnapped": `before` and then
            `steps` from elsewhere.
        truth: `[T, 3]` true poses (m, m, rad).
        before: how many the robot is tracked for before it is carried off.
        steps: how many it is looked for.
        rng: chooses.
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
    """The inputs of these steps; the wheels do not turn where one does not follow the one before."""
    chosen = jax.tree.map(lambda leaf: leaf[rows], inputs)
    jumps = np.flatnonzero(np.diff(rows, prepend=-2) != 1)
    deltas = chosen.odometry.delta.at[jumps].set(jnp.zeros(3, jnp.float32))
    return eqx.tree_at(lambda i: i.odometry.delta, chosen, deltas)


def _measured(infos: AMCLInfo, truth: Float64[np.ndarray, "M 3"], since: int) -> Arrays:
    """How well a trial went; it is looked for from the step `since` on."""
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
        # In updates; one that is never found takes for ever.
        "found_after": np.asarray(np.argmax(known) + 1.0 if known.any() else np.inf),
        "live": np.asarray(infos.num_live),
        "random": np.asarray(infos.num_random),
    }
