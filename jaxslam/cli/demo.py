"""`jaxslam demo`: map a simulated hall, with the ground truth beside the result."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from jaxslam.cli import common, options

if TYPE_CHECKING:
    from jaxslam.pipeline.run import RunResult
    from jaxslam.sim import Truth
    from jaxslam.viz import MapLayer

_TOLERANCE = 0.1
"""Distance within which a wall counts as found, meters: two cells."""


@dataclass(frozen=True)
class Demo:
    """Flags of `jaxslam demo`."""

    out: Annotated[Path | None, options.optional("DIR", "runs/demo-s<seed>", options.FOLDER)] = None
    world: Annotated[str, arg(metavar="NAME")] = "hall_small"
    """World: hall_small (18 × 15 m), hall_large (24 × 23 m), roadway (71 × 26 m, of a coal mine) or
    corridor_loop (43 × 16 m)."""
    duration: float = 200.0
    """Length of the drive, seconds. One tour takes almost 200 in the halls, 190 in the roadway and 125 in the
    corridor."""
    seed: int = 0
    """Random seed of the simulation and of the filter, 0 to 4294967295."""
    method: options.Method = None
    particles: Annotated[int, arg(metavar="N")] = 15
    """Number of particles; each has its own map."""
    set: options.Settings = ()
    range_network: options.RangeNetwork = None
    gif: options.MapAnimation = False


def execute(command: Demo, arguments: list[str]) -> None:
    """Simulate, map, compare, and write a run folder."""
    import jax

    import jaxslam
    from jaxslam.config.resolve import resolve_config
    from jaxslam.report import make_folder, trajectory_figures, write_run

    network = common.read_network(command.range_network)
    config = resolve_config(
        jaxslam.SlamConfig(),
        lidar="sick",
        method=command.method,
        flags={"num_particles": command.particles, "map.margin": 4.0},
        assignments=command.set,
    )
    folder = command.out or Path("runs") / f"demo-s{command.seed}"
    # The filter must not share the random numbers of the simulator, so the simulator has another key.
    key = jax.random.fold_in(jax.random.key(command.seed), 1)
    log, truth = jaxslam.sim.drive(command.world, key=key, duration=command.duration)
    make_folder(folder)
    slam, scans = jaxslam.prepare(log, config, range_network=network)
    result = common.map_log(slam, scans, command.seed, gif=folder / "map.gif" if command.gif else None)
    layer, figures = _compare(truth, result)
    origin = common.origin_of(arguments, command.seed, range_network=command.range_network)
    origin["log"] = {"path": f"simulation of {command.world}, {command.duration:g} s", "sha256": None}
    metrics = write_run(
        folder,
        result,
        origin=origin,
        accuracy={"ate": trajectory_figures(result.error(truth)), "map": figures},
        truth=layer,
    )
    steps = ["jaxslam demo --method fruit-fly --gif", "jaxslam run LOG   (a log or bag of your own)"]
    common.print_run_summary(folder, result, metrics, "sick (simulated)", steps)


def _compare(truth: "Truth", result: "RunResult") -> "tuple[MapLayer, dict[str, float | None]]":
    """Return the true map on the cells of the estimated map, and the score of the estimated map."""
    import numpy as np

    from jaxslam.metrics import BinaryMap, map_score
    from jaxslam.sim import true_map
    from jaxslam.viz import MapLayer

    grid = result.grid
    known = true_map(truth.world, grid, truth.poses[0, :2])
    estimate = BinaryMap.from_log_odds(result.log_odds, grid.resolution, grid.origin)
    score = map_score(known, estimate, tolerance_m=_TOLERANCE)
    names = ("precision", "recall", "f1", "iou", "free_iou")
    figures = {name: getattr(score, name) for name in names} | {"tolerance_m": _TOLERANCE}
    levels = np.where(known.occupied, 1.0, np.where(known.free, 0.0, np.nan))
    return MapLayer(levels, known.resolution, known.origin, truth.poses), figures
