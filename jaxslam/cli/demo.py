"""`jaxslam demo`: the whole way on a simulated hall, with the truth beside it."""

import shlex
from pathlib import Path

import jax
import numpy as np
from jaxtyping import Float64, Int8

from jaxslam.cli.arguments import Demo
from jaxslam.cli.common import check_seed, map_log, network_origin, print_summary, read_network
from jaxslam.config.lidar_presets import PRESETS
from jaxslam.config.resolve import effective_configuration
from jaxslam.config.slam import SlamConfig
from jaxslam.grid.spec import GridSpec
from jaxslam.metrics import BinaryMap, map_score
from jaxslam.pipeline.prepare import prepare
from jaxslam.report import make_folder, reference_error, trajectory_figures, versions, write_run
from jaxslam.report.folder import occupancy_probability
from jaxslam.sim import World, make_world, observable, simulate, to_log
from jaxslam.viz.picture import MapLayer

TOLERANCE = 0.1
"""A wall counts as found within two cells, metres."""


def execute(command: Demo, arguments: list[str]) -> None:
    """Simulates, maps, compares, and writes a run folder."""
    check_seed(command.seed)
    network = read_network(command.range_network)
    world, waypoints = make_world(command.world)
    configuration = effective_configuration(
        SlamConfig(),
        config=None,
        lidar="sick",
        method=command.method,
        flags={"num_particles": command.particles, "map.margin": "4"},
        assignments=command.set,
        detect=lambda: PRESETS["sick"],
    )
    folder = command.out or Path("runs") / f"demo-s{command.seed}"
    make_folder(folder)
    # Another key than the filter's, which knows nothing of the simulator's noise.
    key = jax.random.fold_in(jax.random.key(command.seed), 1)
    simulation = simulate(key, world, waypoints, duration=command.duration)
    log = to_log(simulation, command.world, in_world_frame=True)
    prepared = prepare(log, configuration, network)
    result = map_log(prepared, command.seed, gif=folder / "map.gif" if command.gif else None)
    assert log.scans is not None
    assert log.odometry is not None
    true_poses = np.asarray(simulation.scan_poses, np.float64)
    error = reference_error(log.scans.stamps, true_poses, result.all_stamps, result.all_poses, log.odometry)
    truth, figures = _compare(world, result.grid, result.log_odds, true_poses)
    metrics = write_run(
        folder,
        result,
        configuration,
        seed=command.seed,
        scans_in=len(log.scans.stamps),
        origin={
            "command": shlex.join(["jaxslam", *arguments]),
            "log": {"path": f"simulation of {command.world}, {command.duration:g} s", "sha256": None},
            "range_network": network_origin(command.range_network),
            "versions": versions(),
        },
        accuracy={"ate": trajectory_figures(error), "map": figures},
        truth=truth,
    )
    lidar = f"{configuration.lidar.name} (simulated)"
    print_summary(folder, result, configuration, metrics, lidar, prepared)


def _compare(
    world: World, grid: GridSpec, log_odds: Int8[np.ndarray, "H W"], true_poses: Float64[np.ndarray, "S 3"]
) -> tuple[MapLayer, dict[str, float | None]]:
    """The true map on the cells of the estimated one, and the estimate's score against it."""
    occupied, free = observable(world, grid, true_poses[0, :2])
    resolution, origin = float(grid.resolution), np.asarray(grid.origin, np.float64)
    score = map_score(
        BinaryMap(occupied, free, resolution, origin),
        BinaryMap.from_probability(occupancy_probability(log_odds), resolution, origin),
        tolerance_m=TOLERANCE,
    )
    figures = {
        "precision": score.precision,
        "recall": score.recall,
        "f1": score.f1,
        "iou": score.iou,
        "free_iou": score.free_iou,
        "tolerance_m": TOLERANCE,
    }
    levels = np.where(occupied, 1.0, np.where(free, 0.0, np.nan))
    return MapLayer(levels, resolution, origin, true_poses), figures
