"""One cell: trials in the corridor with one number of particles, or the reference map."""

import dataclasses
import resource
from itertools import pairwise
from typing import Any

import jax
import numpy as np
from jaxtyping import Float64, Int

from experiments._harness.harness import Arrays, Cell, stack_seeds
from experiments._harness.measures import of_first_seed, on_world_grid, pose_errors
from experiments._harness.method import ODOMETRY_NOISE, Method
from experiments.range_network.devices import Quality, device, network
from jaxslam import RBPF, RunResult, SensorLog, prepare, run_log, sim
from jaxslam.io import OdometryTrack
from jaxslam.metrics import BinaryMap, loop_closed, match_features
from jaxslam.pipeline.inputs import PreparedScans
from jaxslam.sim import true_map

MARGIN = 10.0
"""Width of the maps' border around the corridor, meters: 3.5 m for the window, and 6.5 m for errors of the
pose."""
SPEED = 0.12
"""Speed of the robot, m/s."""
SMALL_LOOP, BACK = 12.0, 6.0
"""Distances that the robot drives forth and back for the ground-truth map, meters."""
TURTLEBOT = sim.Robot(max_speed=SPEED, radius=0.15)
WHEELS = sim.WheelOdometry(wheel_radius=0.033, track_width=0.16, ticks_per_turn=4096.0, rate=20.0)


def run_cell(cell: Cell) -> Arrays:
    """Run all trials of a cell. Results have the trials first; `one_map` is of trial 0."""
    settings = cell.settings
    if settings["task"] == "reference":
        return _reference(settings)
    return stack_seeds([_run_trial(settings, seed) for seed in range(settings["seeds"])])


def corridor(small: bool) -> tuple[sim.World, Float64[np.ndarray, "W 2"]]:
    """Return the corridor and a tour; a small corridor serves as a smoke test."""
    if not small:
        return sim.corridor_loop()
    plan = sim.Corridor(length=10.0, depth=8.0, width=1.8)
    return sim.build_corridor("small", plan, np.random.default_rng(0))


def prepared_trial(
    settings: Any, seed: int, duration: float | None = None
) -> tuple[RBPF, PreparedScans, sim.Truth]:
    """Return the filter, the scans and the truth of a trial, which has its own lidar, drive and noise."""
    quality = Quality(settings["bias"], settings["noise"])
    log, truth = _drive(
        corridor(settings["small"]), device(quality, seed), seed, duration or settings["duration"]
    )
    corrected = network(quality, seed) if settings["network"] else None
    slam, scans = prepare(log, mapping(settings["particles"]).configuration(), range_network=corrected)
    return on_world_grid(slam, truth.world, MARGIN), scans, truth


def mapping(particles: int) -> Method:
    """Return the filter of Jamaludin et al., which is gmapping's, with this number of particles."""
    return Method("", "gmapping", particles, lidar="lds-01")


def _drive(
    place: tuple[sim.World, Float64[np.ndarray, "W 2"]], lidar: sim.Lidar, seed: int, duration: float
) -> tuple[SensorLog, sim.Truth]:
    key = jax.random.fold_in(jax.random.key(seed), 2**32 - 2)
    return sim.drive(place, key=key, robot=TURTLEBOT, wheels=WHEELS, lidar=lidar, duration=duration)


def small_loops(tour: Float64[np.ndarray, "W 2"]) -> Float64[np.ndarray, "_ 2"]:
    """Split a tour: `SMALL_LOOP` meters forward, `BACK` meters back, and so on until it is closed."""
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
    slam, scans, driven = prepared_trial(settings, seed)
    truth = driven.poses[scans.scan_index]
    before = _cpu_seconds()
    # A filter without the network may drift to the edge of its map; its loop then counts as open.
    result = run_log(slam, scans, jax.random.key(seed), may_leave_map=True)
    cpu = _cpu_seconds() - before
    mapped, walls = _binary(result), true_map(driven.world, result.grid, truth[0, :2])
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
        **of_first_seed(result, truth, result.stamps - result.stamps[0]),
    }


def _cpu_seconds() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def _binary(result: RunResult) -> BinaryMap:
    return BinaryMap.from_log_odds(result.log_odds, result.grid.resolution, result.grid.origin)


def inliers(cell: Arrays, reference: Arrays) -> Int[np.ndarray, "S"]:
    """Count the features of each trial's map that match the single map of another cell."""
    resolution, origin = float(reference["one_resolution"]), reference["one_origin"]
    wanted = BinaryMap.from_log_odds(reference["one_map"], resolution, origin)
    maps = (BinaryMap.from_log_odds(log_odds, resolution, origin) for log_odds in cell["maps"])
    return np.array([match_features(wanted, mapped).inliers for mapped in maps])


def _reference(settings: Any) -> Arrays:
    """Build a ground-truth map from many particles on small loops (as in the paper), or from known poses.

    The lidar has no bias in both cases, so that the reference does not favor biased maps.
    """
    world, tour = corridor(settings["small"])
    from_known_poses = settings["which"] == "known"
    place = (world, tour if from_known_poses else small_loops(tour))
    log, driven = _drive(place, sim.lds_01(), 1000, settings["duration"])
    method = mapping(settings["particles"])
    if from_known_poses:
        # One particle follows the true poses, which take the place of the odometry.
        unknown = np.full_like(driven.poses, np.nan)
        log = dataclasses.replace(log, odometry=OdometryTrack(driven.stamps, driven.poses, unknown, "truth"))
        method = Method("", "rbpf", 1, dict.fromkeys(ODOMETRY_NOISE, 1e-9), lidar="lds-01")
    slam, scans = prepare(log, method.configuration())
    result = run_log(on_world_grid(slam, world, MARGIN), scans, jax.random.key(1000))
    truth = driven.poses[scans.scan_index]
    position, _ = pose_errors(truth, result.trajectory)
    return {
        "rmse": np.sqrt(np.mean(position**2)),
        **of_first_seed(result, truth, result.stamps - result.stamps[0]),
    }
