"""What `run` and `demo` share: the filter over prepared inputs, warnings, the summary."""

import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import Float64

from jaxslam.config.slam import SlamConfig
from jaxslam.fusion import YawTrack
from jaxslam.io import SensorLog, read_tum
from jaxslam.pipeline.prepare import Prepared
from jaxslam.pipeline.run import RunResult, Snapshot, run_log
from jaxslam.preprocess.deskew import SweepTiming
from jaxslam.range_network import RangeNetwork, load_network
from jaxslam.report import file_sha256
from jaxslam.viz.animation import MapFrame, animate_map

_MAX_SEED = 2**32 - 1


def check_seed(seed: int) -> None:
    """Raises a one-line `ValueError` for a seed that is no 32-bit number."""
    if not 0 <= seed <= _MAX_SEED:
        raise ValueError(f"--seed is {seed}: give 0 to {_MAX_SEED}")


def warn(lines: Iterable[str]) -> None:
    """Prints warnings, one line each, to stderr."""
    for line in lines:
        print(f"jaxslam: warning: {' '.join(line.split())}", file=sys.stderr)


def warn_if_assumed(yaw: YawTrack) -> None:
    """Warns of an IMU of which nothing tells how it is mounted."""
    if yaw.source == "assumed":
        warn(["the log does not say how the IMU is mounted, nor does gravity: z is taken to point up"])


def warn_if_unmounted(log: SensorLog) -> None:
    """Warns of a lidar of which nothing tells how it is mounted, where no other warning has."""
    told = any("mounting" in line or "mounted" in line for line in log.warnings)
    if log.scans is not None and not log.scans.mounting_known and not told:
        x, y, theta = log.scans.pose_base_lidar
        warn([f"the log does not say how the lidar is mounted: taken as x {x:g} m, y {y:g} m, {theta:g} rad"])


def read_reference(path: Path, log: SensorLog) -> tuple[Float64[np.ndarray, "M"], Float64[np.ndarray, "M 3"]]:
    """Stamps and poses of a reference trajectory that belongs to a log.

    Raises:
        ValueError: its stamps run backwards, or fewer than two of its poses lie within the log. Found here,
            it does not cost the run.
    """
    stamps, poses = read_tum(path)
    if np.any(np.diff(stamps) < 0):
        row = int(np.flatnonzero(np.diff(stamps) < 0)[0]) + 1
        raise ValueError(f"{path}: the stamps run backwards at pose {row + 1} ({stamps[row]:.3f} s): sort it")
    if log.scans is not None and len(log.scans.stamps):
        first, last = float(log.scans.stamps[0]), float(log.scans.stamps[-1])
        within = int(np.count_nonzero((stamps >= first - 1e-6) & (stamps <= last + 1e-6)))
        if within < 2:
            raise ValueError(
                f"{path}: {within} of its {len(stamps)} poses ({stamps.min():.3f} to {stamps.max():.3f} s) "
                f"lie within the log's scans ({first:.3f} to {last:.3f} s): is it that of another log?"
            )
    return stamps, poses


def read_network(path: Path | None) -> RangeNetwork | None:
    """The network that `--range-network` names; None without."""
    return None if path is None else load_network(path)


def network_origin(path: Path | None) -> dict[str, str] | None:
    """Which network it was, for `run.json`."""
    return None if path is None else {"path": str(path.resolve()), "sha256": file_sha256(path)}


def describe_timing(timing: SweepTiming | None) -> str:
    """What a user should know of the scans' stamps; empty where they agree with the odometry's."""
    if timing is None or timing.lag is None:
        return ""
    late = "late" if timing.lag.seconds < 0 else "early"
    return (
        f"stamped {abs(timing.lag.seconds):.2f} s {late}: the scans' turning follows the odometry's best "
        f"there (correlation {timing.lag.correlation:.2f})"
    )


def map_log(prepared: Prepared, seed: int, *, gif: Path | None) -> RunResult:
    """Runs a filter, with a progress bar on a terminal, and prints its warnings.

    Args:
        prepared: the filter and its inputs.
        seed: of the key.
        gif: where to write the map as it is built, or None.
    """
    frames: list[MapFrame] = []

    def keep(snapshot: Snapshot) -> None:
        caption = f"{len(snapshot.trajectory)} scans"
        frames.append(MapFrame(snapshot.log_odds, snapshot.trajectory, snapshot.particles, caption))

    result = run_log(
        prepared.slam,
        jax.random.key(seed),
        prepared.inputs,
        progress=sys.stderr.isatty(),
        on_chunk=keep if gif is not None else None,
    )
    if gif is not None:
        animate_map(gif, frames, result.grid.resolution, result.grid.origin)
    warn(result.warnings)
    return result


def print_summary(
    folder: Path,
    result: RunResult,
    configuration: SlamConfig,
    metrics: Mapping[str, Any],
    lidar: str,
    prepared: Prepared,
) -> None:
    """Prints what a user wants to know first, on stdout."""
    height, width = result.log_odds.shape
    side = float(configuration.map.resolution)
    count = configuration.num_particles
    megabytes = count * height * width / 1e6
    lines = {
        "lidar": f"{lidar}, usable range {float(configuration.lidar.usable_range):g} m",
        "maps": f"{count} of {width * side:.1f} × {height * side:.1f} m, {megabytes:.1f} MB",
        "scans": f"{metrics['scans_processed']} processed of {metrics['scans_in']}",
        "time": f"{metrics['ms_per_scan']:.2f} ms per scan, compilation {metrics['compile_s']:.1f} s apart",
    }
    if prepared.fused is not None and prepared.yaw is not None:
        readings = prepared.fused.readings["imu"]
        lines["odometry"] = f"fused with {readings} IMU readings (up from: {prepared.yaw.source})"
    if stamped := describe_timing(prepared.timing):
        lines["stamps"] = f"{stamped}; corrected"
    if relations := metrics.get("relations"):
        lines["relations"] = (
            f"{relations['trans_mean_m']:.4f} ± {relations['trans_std_m']:.4f} m, max "
            f"{relations['trans_max_m']:.3f} m; {relations['rot_mean_deg']:.3f} ± "
            f"{relations['rot_std_deg']:.3f}° ({relations['n']} relations)"
        )
    if ate := metrics.get("ate"):
        lines["ATE"] = (
            f"{ate['rmse_m']:.4f} m RMSE, max {ate['max_m']:.3f} m, heading {ate['rot_rmse_deg']:.2f}° "
            f"({ate['n']} poses)"
        )
    if score := metrics.get("map"):
        lines["map"] = (
            f"precision {score['precision']:.3f}, recall {score['recall']:.3f}, IoU {score['iou']:.3f} of "
            f"walls within {score['tolerance_m']:g} m; IoU of free space {score['free_iou']:.3f}"
        )
    lines["written"] = f"{folder} (map.png, map.yaml, trajectory.tum, metrics.json, …)"
    for label, text in lines.items():
        print(f"{label:<10}{text}")
