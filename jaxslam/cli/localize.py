"""`jaxslam localize LOG --map MAP.yaml`."""

import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import arg

from jaxslam.cli import common, options

if TYPE_CHECKING:
    from jaxslam.io import OccupancyMap
    from jaxslam.pipeline.localize import Cloud, LocalizationResult

_FAR = 1e5
"""Distance up to which single precision resolves a centimeter, meters."""


@dataclass(frozen=True)
class Localize:
    """Flags of `jaxslam localize`."""

    log: options.Log
    map: Annotated[Path, arg(metavar="MAP.yaml")]
    """Map in the format of map_server and nav2: a yaml file with an image beside it."""
    start: Annotated[str | None, options.optional("X,Y,THETA", "none")] = None
    """Start pose in the map frame: meters, meters, radians. Its uncertainty is set by start.deviation (0.5 m)
    and start.rotation_deviation (0.26 rad)."""
    global_: Annotated[options.Switch, arg(name="global")] = False
    """Start pose unknown: search the whole map."""
    seed: options.Seed = 0
    particles: Annotated[int | None, options.optional("N", "100000")] = None
    """Largest number of particles. A global start uses all of them; later the number adapts."""
    reference: options.File = None
    """Reference trajectory in the map frame (TUM format, seconds and meters) to measure the error against."""
    config: options.File = None
    """Configuration in TOML, as `jaxslam config --localization` prints it. It may contain any subset of the
    settings."""
    set: options.Settings = ()
    lidar: options.Lidar = None
    range_network: options.RangeNetwork = None
    scan_topic: options.ScanTopic = None
    odom_topic: options.OdomTopic = None
    gif: options.Switch = False
    """Also write cloud.gif, an animation of the particles on the map."""
    out: Annotated[Path | None, options.optional("DIR", "runs/<log>-amcl-s<seed>", options.FOLDER)] = None


def execute(command: Localize, arguments: list[str]) -> None:
    """Localize a log on a map and write its run folder."""
    import jax

    import jaxslam
    from jaxslam.config.resolve import resolve_config
    from jaxslam.io import read_map
    from jaxslam.localization.start import check_start
    from jaxslam.report import default_folder, make_folder
    from jaxslam.report.localization_folder import write_localization
    from jaxslam.viz.clouds import animate_clouds

    start = _start(command)
    network = common.read_network(command.range_network)
    map = read_map(command.map)
    log = common.read_log(command.log, scan_topic=command.scan_topic, odom_topic=command.odom_topic)
    reference = common.read_reference(command.reference, log)
    config = resolve_config(
        jaxslam.LocalizationConfig(),
        log=log,
        config=command.config,
        lidar=command.lidar,
        flags={"max_particles": command.particles},
        assignments=command.set,
    )
    localizer, scans = jaxslam.prepare_localization(log, map, config, range_network=network)
    if start is not None:
        check_start(localizer.map, start)
    _warn_if_far(command.map, map)
    folder = command.out or default_folder(command.log, "amcl", command.seed)
    make_folder(folder)
    clouds: list[Cloud] = []
    result = jaxslam.localize_log(
        localizer,
        scans,
        jax.random.key(command.seed),
        start,
        deviations=(float(config.start.deviation), float(config.start.rotation_deviation)),
        progress=sys.stderr.isatty(),
        on_chunk=clouds.append if command.gif else None,
    )
    common.warn(*result.warnings)
    error = None
    if reference is not None:
        try:
            error = result.error(reference)
        except ValueError as reason:  # The run is complete without the error.
            common.warn(f"{command.reference}: no error is reported: {reason}")
    if command.gif:
        animate_clouds(folder / "cloud.gif", result.map, clouds)
    origin = common.origin_of(
        arguments, command.seed, log=command.log, map=command.map, range_network=command.range_network
    )
    origin["start"] = "global" if start is None else list(start)
    metrics = write_localization(folder, result, origin=origin, error=error)
    _print_summary(folder, result, metrics)


def _warn_if_far(path: Path, map: "OccupancyMap") -> None:
    import numpy as np

    farthest = float(np.abs(map.origin[:2]).max())
    if farthest > _FAR:
        precision = float(np.spacing(np.float32(farthest)))
        common.warn(
            f"{path}: its origin is {farthest:.0f} m away from 0, where positions are resolved to only "
            f"{precision:.2g} m: move the origin closer to 0"
        )


def _start(command: Localize) -> tuple[float, float, float] | None:
    if (command.start is None) == (not command.global_):
        raise ValueError("give either --start X,Y,THETA (meters, meters, radians) or --global")
    if command.start is None:
        return None
    try:
        x, y, theta = map(float, command.start.split(","))
    except ValueError:
        x = y = theta = math.nan
    if not math.isfinite(x + y + theta):
        raise ValueError(f"--start is {command.start!r}: give X,Y,THETA in meters, meters and radians")
    return x, y, theta


def _print_summary(folder: Path, result: "LocalizationResult", metrics: dict[str, Any]) -> None:
    import numpy as np

    x, y, theta = result.estimates[-1]
    deviation = float(np.sqrt(np.trace(result.covariances[-1][:2, :2])))
    counts = np.asarray(result.infos.num_particles)
    after = metrics["converged_after_s"]
    lines = {
        "picture": str(folder / "cloud.png"),
        "scans": common.describe_scans(result.scans),
        "time": (
            f"{result.ms_per_scan:.2f} ms per scan, plus {result.compile_s:.1f} s to compile; "
            f"{metrics['beam_evaluations_per_s']:.2g} beams per second"
        ),
        "particles": f"{counts[0]} at first, median {int(np.median(counts))}, {counts[-1]} at the end",
        "converged": (
            ("yes" if result.converged else "no")
            + ("" if after is None else f", first after {after:.1f} s")
            + f"; {result.kidnapped_events} jumps to another place"
        ),
        "end": f"x {x:.2f} m, y {y:.2f} m, {np.rad2deg(theta):.1f}°, ± {deviation:.2f} m",
    }
    if np.isfinite(metrics["match_score"]):
        lines["match"] = f"{100 * metrics['match_score']:.1f} % of the beams end on the map"
    if ate := metrics.get("ate"):
        lines["error"] = common.describe_ate(ate)
    lines["written"] = f"{folder} (cloud.png, trajectory.tum, metrics.json, …)"
    common.print_table(lines)
