"""One cell: trials in the corridor with one number of particles, or the map that they are measured by."""

import dataclasses
import resource
from itertools import pairwise
from typing import Any

import jax
import numpy as np
from jaxtyping import Float64, Int, Int8

from experiments.harness import Arrays, Cell, stack_seeds
from experiments.measures import of_the_first_seed, on_the_worlds_grid, pose_errors, true_map
from experiments.method import ODOMETRY_NOISE, Method
from experiments.range_network.devices import Quality, device, network
from jaxslam.io.log import OdometryTrack
from jaxslam.metrics import BinaryMap, loop_closed, match_features
from jaxslam.pipeline.prepare import Prepared, prepare
from jaxslam.pipeline.run import RunResult, run_log
from jaxslam.range_network import RangeNetwork
from jaxslam.report.folder import occupancy_probability
from jaxslam.sim import (
    Corridor,
    Lidar,
    Robot,
    WheelOdometry,
    World,
    build_corridor,
    corridor_loop,
    lds_01,
    simulate,
    to_log,
)

MARGIN = 10.0
"""Of the maps round the corridor, metres: the window's 3.5 m, and what a robot may be off by before it counts
for lost."""
SPEED = 0.12
"""Of the robot, m/s."""
SMALL_LOOP, BACK = 12.0, 6.0
"""For the ground truth the robot drives forth and back by so many metres."""
TURTLEBOT = Robot(max_speed=SPEED, radius=0.15)
WHEELS = WheelOdometry(wheel_radius=0.033, track_width=0.16, ticks_per_turn=4096.0, rate=20.0)


def run_cell(cell: Cell) -> Arrays:
    """All trials of a cell. What varies over them has them first; the map is that of trial 0."""
    settings = cell.settings
    if settings["task"] == "reference":
        return _reference(settings)
    return stack_seeds([_run_trial(settings, seed) for seed in range(settings["seeds"])])


def corridor(small: bool) -> tuple[World, Float64[np.ndarray, "W 2"]]:
    """The corridor and a tour; a small one to see that all of it runs."""
    if not small:
        return corridor_loop()
    return build_corridor("small", Corridor(length=10.0, depth=8.0, width=1.8), np.random.default_rng(0))


def prepared_trial(
    settings: Any, seed: int, duration: float | None = None
) -> tuple[World, np.ndarray, Prepared]:
    """The world, the true poses at the processed scans `[T, 3]`, and the filter with its inputs.

    Every trial has another lidar, another drive and other noise.
    """
    quality = Quality(settings["bias"], settings["noise"])
    world, tour = corridor(settings["small"])
    corrected = network(quality, seed) if settings["network"] else None
    lasts, method = duration or settings["duration"], mapping(settings["particles"])
    return _prepared(world, tour, device(quality, seed), seed, lasts, method, corrected)


def mapping(particles: int) -> Method:
    """The paper's filter, gmapping's, with so many particles."""
    return Method("", "gmapping", particles, lidar="lds-01")


def _prepared(
    world: World,
    tour: Float64[np.ndarray, "W 2"],
    lidar: Lidar,
    seed: int,
    duration: float,
    method: Method,
    corrected: RangeNetwork | None = None,
    *,
    poses_known: bool = False,
) -> tuple[World, np.ndarray, Prepared]:
    key = jax.random.fold_in(jax.random.key(seed), 2**32 - 2)
    simulation = simulate(key, world, tour, robot=TURTLEBOT, wheels=WHEELS, lidar=lidar, duration=duration)
    log = to_log(simulation, world.name, in_world_frame=True)
    true_poses = np.asarray(simulation.scan_poses, np.float64)
    if poses_known:
        assert log.scans is not None
        truth = OdometryTrack(log.scans.stamps, true_poses, np.full_like(true_poses, np.nan), "truth")
        log = dataclasses.replace(log, odometry=truth)
    prepared = on_the_worlds_grid(prepare(log, method.configuration(), corrected), world, MARGIN)
    return world, true_poses[prepared.inputs.scan_index], prepared


def small_loops(tour: Float64[np.ndarray, "W 2"]) -> Float64[np.ndarray, "_ 2"]:
    """A tour as `SMALL_LOOP` metres forth, `BACK` metres back, and so on until it is round."""
    closed = np.vstack([tour, tour[:1]])
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(closed, axis=0).T))])
    stops = [0.0]
    while stops[-1] < along[-1]:
        end = min(stops[-1] + SMALL_LOOP, along[-1])
        stops += [end] if end == along[-1] else [end, end - BACK]
    points: list[float] = []
    for before, after in pairwise(stops):
        corners = along[(along > min(before, after)) & (along < max(before, after))]
        points += [before, *(corners if after > before else corners[::-1])]
    return np.stack([np.interp(points, along, closed[:, axis]) for axis in (0, 1)], axis=1)


def _run_trial(settings: Any, seed: int) -> Arrays:
    world, truth, prepared = prepared_trial(settings, seed)
    before = _cpu_seconds()
    # Without the network a robot may be as far off as that: its loop is open.
    result = run_log(prepared.slam, jax.random.key(seed), prepared.inputs, may_leave_map=True)
    cpu = _cpu_seconds() - before
    mapped, walls = _binary(result), true_map(world, result.grid, truth[0, :2])
    closure = loop_closed(truth, result.trajectory, walls, mapped)
    position, _ = pose_errors(truth, result.trajectory)
    occupied = np.argwhere(mapped.occupied)
    extent = (occupied.max(axis=0) - occupied.min(axis=0) + 1)[::-1] * mapped.resolution
    return {
        "closed": np.asarray(closure.closed),
        "loop_position": np.asarray(closure.position_error),
        "walls_once": np.asarray(closure.walls_once),
        "maps": result.log_odds,
        "extent": extent,
        "rmse": np.sqrt(np.mean(position**2)),
        "cpu_seconds": np.asarray(cpu),
        "map_megabytes": np.asarray(settings["particles"] * result.log_odds.size / 1e6),
        "peak_megabytes": np.asarray(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3),
        **of_the_first_seed(result, truth, result.stamps - result.stamps[0]),
    }


def _cpu_seconds() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def _binary(result: RunResult) -> BinaryMap:
    return binary_map(result.log_odds, float(result.grid.resolution), np.asarray(result.grid.origin))


def binary_map(log_odds: Int8[np.ndarray, "H W"], resolution: float, origin: np.ndarray) -> BinaryMap:
    """Occupied and free cells of a filter's map."""
    return BinaryMap.from_probability(
        occupancy_probability(log_odds), resolution, np.asarray(origin, np.float64)
    )


def inliers(cell: Arrays, reference: Arrays) -> Int[np.ndarray, "S"]:
    """How many features of each trial's map are found again in the one map of another cell."""
    resolution, origin = float(reference["one_resolution"]), reference["one_origin"]
    wanted = binary_map(reference["one_map"], resolution, origin)
    maps = (binary_map(log_odds, resolution, origin) for log_odds in cell["maps"])
    return np.array([match_features(wanted, mapped).inliers for mapped in maps])


def _reference(settings: Any) -> Arrays:
    """A ground-truth map, the paper's way from many particles on small loops, or from known poses.

    Both by a lidar without bias: what the maps are measured by must not have the habits of one that is.
    """
    world, tour = corridor(settings["small"])
    lidar = lds_01()
    if settings["which"] == "built":
        tour, method = small_loops(tour), mapping(settings["particles"])
    else:
        # One particle that goes where it is told.
        method = Method("", "rbpf", 1, dict.fromkeys(ODOMETRY_NOISE, 1e-9), lidar="lds-01")
    _, truth, prepared = _prepared(
        world, tour, lidar, 1000, settings["duration"], method, poses_known=settings["which"] == "known"
    )
    result = run_log(prepared.slam, jax.random.key(1000), prepared.inputs)
    position, _ = pose_errors(truth, result.trajectory)
    return {
        "rmse": np.sqrt(np.mean(position**2)),
        **of_the_first_seed(result, truth, result.stamps - result.stamps[0]),
    }
