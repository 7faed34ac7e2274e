"""Share flags, input checks, warnings and summaries between the commands.

A command module is imported for `--help`, so it imports the rest of jaxslam where it runs, not at its top.
"""

import shlex
import sys
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import FlagCreatePairsOff, Positional, UseAppendAction, arg

if TYPE_CHECKING:
    from jaxslam.core.trajectory import Trajectory
    from jaxslam.fusion import YawTrack
    from jaxslam.io import SensorLog
    from jaxslam.pipeline.inputs import PreparedScans
    from jaxslam.pipeline.run import RunResult, Snapshot
    from jaxslam.preprocess.deskew import SweepTiming
    from jaxslam.range_network import RangeNetwork
    from jaxslam.slam.rbpf import RBPF


_NONE = "(default: none)"
_FROM_CONFIG = "(default: from the configuration, see `jaxslam config`)"

LogPath = Annotated[Path, Positional, arg(metavar="LOG")]
"""The log file, or the folder of a ROS 2 bag."""
Particles = Annotated[int | None, arg(metavar="N", help_behavior_hint=_FROM_CONFIG)]
# Names are checked by the configuration, whose errors suggest the nearest name.
Method = Annotated[
    str | None, arg(metavar="rbpf|gmapping|fruit-fly|gaussian", help_behavior_hint="(default: gmapping)")
]
Lidar = Annotated[
    str | None, arg(metavar="NAME", help_behavior_hint="(default: chosen by the scans of the log)")
]
Assignments = Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="NAME=VALUE", help_behavior_hint=_NONE)]
File = Annotated[Path | None, arg(metavar="FILE", help_behavior_hint=_NONE)]
Topic = Annotated[str | None, arg(metavar="TOPIC", help_behavior_hint="(default: auto-detected)")]
YawAxis = Annotated[
    str | None, arg(metavar="x|y|z|-x|-y|-z", help_behavior_hint="(default: from the log, or from gravity)")
]
Switch = FlagCreatePairsOff[bool]

_MAX_SEED = 2**32 - 1


def check_seed(seed: int) -> None:
    """Raise a one-line `ValueError` for a seed outside 0 to 2³² − 1."""
    if not 0 <= seed <= _MAX_SEED:
        raise ValueError(f"--seed is {seed}: give 0 to {_MAX_SEED}")


def warn(lines: Iterable[str]) -> None:
    """Print warnings to stderr, one line each."""
    for line in lines:
        print(f"jaxslam: warning: {' '.join(line.split())}", file=sys.stderr)


def print_table(lines: Mapping[str, str], width: int = 10) -> None:
    """Print labels and texts in two columns."""
    for label, text in lines.items():
        print(f"{label:<{width}}{text}")


def warn_if_assumed(yaw: "YawTrack") -> None:
    """Warn if neither the log nor gravity shows how the IMU is mounted."""
    if yaw.source == "assumed":
        warn(["neither the log nor gravity shows how the IMU is mounted: its z axis is assumed to point up"])


def read_log(
    path: Path, *, scan_topic: str | None = None, odom_topic: str | None = None, imu_topic: str | None = None
) -> "SensorLog":
    """Read a log and print its warnings, including one for an unknown mounting of the lidar."""
    import jaxslam

    log = jaxslam.read_log(path, scan_topic=scan_topic, odometry_topic=odom_topic, imu_topic=imu_topic)
    warn(log.warnings)
    is_reported = any("mounting" in line or "mounted" in line for line in log.warnings)
    if log.scans is not None and not log.scans.mounting_known and not is_reported:
        x, y, theta = log.scans.pose_base_lidar
        warn([f"the log does not say how the lidar is mounted: assuming x {x:g} m, y {y:g} m, {theta:g} rad"])
    return log


def read_reference(path: Path, log: "SensorLog") -> "Trajectory":
    """Read the reference trajectory of a log.

    Raises:
        ValueError: its stamps run backwards, or fewer than two of its poses lie within the log. The check
            runs before the filter does.
    """
    import numpy as np

    from jaxslam.io import read_tum

    reference = read_tum(path)
    stamps = reference.stamps
    if np.any(np.diff(stamps) < 0):
        row = int(np.flatnonzero(np.diff(stamps) < 0)[0]) + 1
        raise ValueError(
            f"{path}: the stamps run backwards at pose {row + 1} ({stamps[row]:.3f} s): sort the poses"
        )
    if log.scans is not None and len(log.scans.stamps):
        first, last = float(log.scans.stamps[0]), float(log.scans.stamps[-1])
        within = int(np.count_nonzero((stamps >= first - 1e-6) & (stamps <= last + 1e-6)))
        if within < 2:
            raise ValueError(
                f"{path}: {within} of its {len(stamps)} poses ({stamps.min():.3f} to {stamps.max():.3f} s) "
                f"lie within the log's scans ({first:.3f} to {last:.3f} s): does it belong to another log?"
            )
    return reference


def read_network(path: Path | None) -> "RangeNetwork | None":
    """Load the network given by `--range-network`; return None without the flag."""
    if path is None:
        return None
    from jaxslam.range_network import load_network

    return load_network(path)


def origin_of(arguments: list[str], seed: int | None = None, **files: Path | None) -> dict[str, object]:
    """Return the provenance of a result for `run.json`.

    Args:
        arguments: arguments of the command line.
        seed: seed of the run; None leaves it out.
        files: input files by name; None for a file that was not given.
    """
    from jaxslam.report import file_sha256, versions

    return {
        **({} if seed is None else {"seed": seed}),
        "command": shlex.join(["jaxslam", *arguments]),
        **{
            name: None if path is None else {"path": str(path.resolve()), "sha256": file_sha256(path)}
            for name, path in files.items()
        },
        "versions": versions(),
    }


def describe_timing(timing: "SweepTiming | None") -> str:
    """Describe how the stamps of the scans differ from those of the odometry; empty if they agree."""
    if timing is None or timing.lag is None:
        return ""
    late = "late" if timing.lag.seconds < 0 else "early"
    return (
        f"stamped {abs(timing.lag.seconds):.2f} s {late}: this shift aligns the scans' rotation with the "
        f"odometry's (correlation {timing.lag.correlation:.2f})"
    )


def map_log(slam: "RBPF", scans: "PreparedScans", seed: int, *, gif: Path | None) -> "RunResult":
    """Run a filter, with a progress bar on a terminal, and print its warnings.

    Args:
        slam: the filter.
        scans: the scans that it processes.
        seed: seed of the PRNG key.
        gif: where to write an animation of the map, or None.
    """
    import jax

    import jaxslam

    on_chunk, frames = _frames() if gif is not None else (None, [])
    result = jaxslam.run_log(
        slam, scans, jax.random.key(seed), progress=sys.stderr.isatty(), on_chunk=on_chunk
    )
    if gif is not None:
        jaxslam.viz.animate_map(gif, frames, result.grid.resolution, result.grid.origin)
    warn(result.warnings)
    return result


def _frames() -> "tuple[Callable[[Snapshot], None], list[Any]]":
    from jaxslam.viz import MapFrame

    frames: list[Any] = []

    def keep(snapshot: "Snapshot") -> None:
        caption = f"{len(snapshot.trajectory)} scans"
        frames.append(MapFrame(snapshot.log_odds, snapshot.trajectory, snapshot.particles, caption))

    return keep, frames


def print_run_summary(
    folder: Path, result: "RunResult", metrics: Mapping[str, Any], lidar: str, next_steps: Iterable[str]
) -> None:
    """Print the summary of a run.

    Args:
        folder: run folder.
        result: result of `run_log`.
        metrics: content of `metrics.json`.
        lidar: name of the lidar and its source.
        next_steps: commands to suggest.
    """
    scans, config = result.scans, result.scans.config
    assert config is not None
    assert config.lidar is not None
    height, width = result.log_odds.shape
    side, count = float(result.grid.resolution), len(result.particles)
    lines = {
        "picture": str(folder / "map.png"),
        "lidar": f"{lidar}, usable range {float(config.lidar.usable_range):g} m",
        "maps": f"{count} of {width * side:.1f} × {height * side:.1f} m, "
        f"{count * height * width / 1e6:.1f} MB",
        "scans": f"{metrics['scans_processed']} processed of {metrics['scans_in']}",
        "time": f"{metrics['ms_per_scan']:.2f} ms per scan, plus {metrics['compile_s']:.1f} s to compile",
    }
    if scans.fused is not None and scans.yaw is not None:
        readings = scans.fused.readings["imu"]
        lines["odometry"] = f"fused with {readings} IMU readings (direction of up: {scans.yaw.source})"
    if stamped := describe_timing(scans.timing):
        lines["stamps"] = f"{stamped}; corrected"
    if relations := metrics.get("relations"):
        lines["relations"] = (
            f"{relations['trans_mean_m']:.4f} ± {relations['trans_std_m']:.4f} m, max "
            f"{relations['trans_max_m']:.3f} m; {relations['rot_mean_deg']:.3f} ± "
            f"{relations['rot_std_deg']:.3f}° ({relations['n']} relations)"
        )
    if ate := metrics.get("ate"):
        lines["ATE"] = describe_ate(ate)
    if score := metrics.get("map"):
        lines["map"] = (
            f"precision {score['precision']:.3f}, recall {score['recall']:.3f}, IoU {score['iou']:.3f} of "
            f"walls within {score['tolerance_m']:g} m; IoU of free space {score['free_iou']:.3f}"
        )
    lines["written"] = f"{folder} (map.png, map.yaml, trajectory.tum, metrics.json, …)"
    print_table(lines)
    for label, step in zip(["next", *[""] * 9], next_steps, strict=False):
        print(f"{label:<10}{step}")


def describe_ate(ate: Mapping[str, Any]) -> str:
    """Describe an absolute trajectory error from `metrics.json`."""
    return (
        f"{ate['rmse_m']:.4f} m RMSE, max {ate['max_m']:.3f} m, heading {ate['rot_rmse_deg']:.2f}° "
        f"({ate['n']} poses)"
    )
