"""Input checks, warnings and summaries that several commands share.

A command module is imported for `--help`, so it imports the rest of jaxslam where it runs, not at its top.
"""

import shlex
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jaxslam.core.trajectory import Trajectory
    from jaxslam.fusion import YawTrack
    from jaxslam.io import SensorLog
    from jaxslam.pipeline.inputs import PreparedScans
    from jaxslam.pipeline.run import RunResult, Snapshot
    from jaxslam.preprocess.deskew import SweepTiming
    from jaxslam.range_network import RangeNetwork
    from jaxslam.slam.rbpf import RBPF


def warn(*warnings: str) -> None:
    """Print warnings to stderr, one line each."""
    for text in warnings:
        print(f"jaxslam: warning: {' '.join(text.split())}", file=sys.stderr)


def print_table(lines: Mapping[str, str], width: int = 10) -> None:
    """Print labels and texts in two columns."""
    for label, text in lines.items():
        print(f"{label:<{width}}{text}")


def warn_if_assumed(yaw: "YawTrack") -> None:
    """Warn if neither the log nor gravity shows how the IMU is mounted."""
    if yaw.source == "assumed":
        warn("neither the log nor gravity shows how the IMU is mounted: its z axis is assumed to point up")


def read_log(
    path: Path, *, scan_topic: str | None = None, odom_topic: str | None = None, imu_topic: str | None = None
) -> "SensorLog":
    """Read a log and print its warnings, including one for an unknown mounting of the lidar."""
    import jaxslam

    log = jaxslam.read_log(path, scan_topic=scan_topic, odometry_topic=odom_topic, imu_topic=imu_topic)
    warn(*log.warnings)
    is_reported = any("mounting" in line or "mounted" in line for line in log.warnings)
    if log.scans is not None and not log.scans.mounting_known and not is_reported:
        x, y, theta = log.scans.pose_base_lidar
        warn(f"the log does not say how the lidar is mounted: assuming x {x:g} m, y {y:g} m, {theta:g} rad")
    return log


def read_reference(path: Path | None, log: "SensorLog") -> "Trajectory | None":
    """Read the trajectory given by `--reference`; return None without the flag.

    Raises:
        ValueError: its stamps run backwards, or fewer than two of its poses lie within the log.
    """
    if path is None:
        return None
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
    """Return the provenance of a result for `run.json`: command, seed, versions, and hashes of its files."""
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


def describe_scans(scans: "PreparedScans") -> str:
    """Describe how many scans were processed, and the thinning that chose them."""
    assert scans.config is not None  # the commands prepare scans for a configuration
    step, turn = scans.config.thinning.min_translation, scans.config.thinning.min_rotation
    return f"{len(scans.stamps)} processed of {scans.num_scans} (thinned: {step:g} m or {turn:g} rad)"


def map_log(slam: "RBPF", scans: "PreparedScans", seed: int, *, gif: Path | None) -> "RunResult":
    """Run a filter with a progress bar on a terminal, write an animation to `gif`, and print warnings."""
    import jax

    import jaxslam

    snapshots: list[Snapshot] = []
    result = jaxslam.run_log(
        slam,
        scans,
        jax.random.key(seed),
        progress=sys.stderr.isatty(),
        on_chunk=snapshots.append if gif else None,
    )
    if gif is not None:
        frames = [
            jaxslam.viz.MapFrame(at.log_odds, at.trajectory, at.particles, f"{len(at.trajectory)} scans")
            for at in snapshots
        ]
        jaxslam.viz.animate_map(gif, frames, result.grid.resolution, result.grid.origin)
    warn(*result.warnings)
    return result


def print_run_summary(
    folder: Path, result: "RunResult", metrics: Mapping[str, Any], lidar: str, next_steps: Iterable[str]
) -> None:
    """Print the summary of a run: its `metrics.json`, its lidar and the commands to suggest."""
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
        "scans": describe_scans(scans),
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
    lines["next"] = f"\n{'':10}".join(next_steps)
    print_table(lines)


def describe_ate(ate: Mapping[str, Any]) -> str:
    """Describe an absolute trajectory error from `metrics.json`."""
    return (
        f"{ate['rmse_m']:.4f} m RMSE, max {ate['max_m']:.3f} m, heading {ate['rot_rmse_deg']:.2f}° "
        f"({ate['n']} poses)"
    )
