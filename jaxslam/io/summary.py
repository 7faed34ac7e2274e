"""Text summary of a log: `jaxslam info LOG`."""

import textwrap
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

from jaxslam.core.trajectory import net_rotation, path_length
from jaxslam.io.gps import east_north
from jaxslam.io.log import ImuTrack, OdometryTrack, ScanTrack, SensorLog, Track

_WIDTH = 100
_INDENT = 14
_NUM_GAPS = 3
# Pauses are listed from this number of usual periods; shorter ones are jitter.
_GAP_PERIODS = 3.0


def summarize(log: SensorLog) -> str:
    """Describe a log in plain text of at most 100 columns.

    For every track: number of messages, duration, rate, gaps. For scans also beams, field of view,
    range interval, share of beams with a return and mounting; for the odometry path length and net
    rotation. At the end: unused topics and the reader's warnings.

    Args:
        log: any log.

    Returns:
        Lines joined by newlines, without a newline at the end.
    """
    lines = _wrap("log", str(log.path))
    lines += _scan_lines(log.scans) if log.scans else _wrap("scans", "none")
    lines += _odometry_lines(log.odometry) if log.odometry else _wrap("odometry", "none")
    lines += _imu_lines(log.imu) if log.imu else []
    if log.joints:
        lines += _track_lines("joints", log.joints, "readings", ", ".join(log.joints.names) or "no names")
    if log.fixes:
        east, north = np.ptp(east_north(log.fixes.positions), axis=0)
        lines += _track_lines("GPS", log.fixes, "fixes", f"extent {east:.0f} m east × {north:.0f} m north")
    used = {name for track in log.tracks.values() for name in track.topic.split(" and ")}
    # A CARMEN log's parameters and a bag's static transforms are used in the tracks.
    used |= {"PARAM"} | {topic for topic in log.topics if topic.endswith("tf_static")}
    unused = [f"{topic} ({count})" for topic, count in log.topics.items() if topic not in used]
    lines += _wrap("not used", ", ".join(unused) or "none")
    for number, warning in enumerate(log.warnings):
        lines += _wrap("warnings" if number == 0 else "", f"- {warning}", hang=2)
    if not log.warnings:
        lines += _wrap("warnings", "none")
    return "\n".join(lines)


def _wrap(label: str, text: str, hang: int = 0) -> list[str]:
    return textwrap.wrap(
        text,
        width=_WIDTH,
        initial_indent=f"{label:<{_INDENT}}",
        subsequent_indent=" " * (_INDENT + hang),
        break_on_hyphens=False,
    )


def _track_lines(label: str, track: Track, unit: str, *details: str) -> list[str]:
    """Describe the number, duration, rate and gaps of a track's rows, which are called `unit`."""
    stamps = track.stamps
    timing = f"{stamps.size} {unit} on {track.topic}"
    duration = np.ptp(stamps) if stamps.size else 0.0
    if duration > 0:
        timing += f", {duration:.1f} s, {(stamps.size - 1) / duration:.2f} Hz"
    lines = _wrap(label, timing)
    for detail in details:
        lines += _wrap("", detail)
    steps = np.diff(stamps)
    if steps.size == 0:
        return lines
    largest = np.argsort(-steps, kind="stable")[:_NUM_GAPS]
    gaps = [
        f"{steps[row]:.3g} s after {stamps[row] - stamps[0]:.1f} s"
        for row in largest
        if steps[row] > _GAP_PERIODS * np.median(steps)
    ]
    none = f"none over {_GAP_PERIODS:g} periods (largest {steps.max():.3g} s)"
    return lines + _wrap("", f"gaps: {', '.join(gaps) or none}")


def _interval(values: Float64[np.ndarray, "T"] | Sequence[int], form: str) -> str:
    low, high = f"{min(values):{form}}", f"{max(values):{form}}"
    return low if low == high else f"{low} to {high}"


def _scan_lines(scans: ScanTrack) -> list[str]:
    step = np.rad2deg(scans.angle_increment)
    first = np.rad2deg(scans.angle_min)
    span = np.abs(step) * (scans.num_beams - 1)
    returns = scans.ranges[np.isfinite(scans.ranges)]
    measured = ""
    if returns.size:
        low, middle, high = np.percentile(returns, [0, 50, 100])
        measured = f"measured {low:.2f} to {high:.2f} m, median {middle:.2f} m; "
    x, y, theta = scans.pose_base_lidar
    source = "" if scans.mounting_known else " (assumed: not in the log)"
    return _track_lines(
        "scans",
        scans,
        "scans",
        f"{_interval(scans.num_beams.tolist(), 'd')} beams, {_interval(step, '.3f')}° apart from "
        f"{_interval(first, '.1f')}° on, over {_interval(span, '.1f')}°",
        f"sensor {scans.range_min:.4g} to {scans.range_max:.4g} m; {measured}"
        f"{returns.size / max(scans.num_beams.sum(), 1):.1%} of the beams have a return",
        f"lidar at x {x:.3f} m, y {y:.3f} m, heading {np.rad2deg(theta):.1f}°{source}",
    )


def _odometry_lines(odometry: OdometryTrack) -> list[str]:
    turned = np.rad2deg(net_rotation(odometry.poses))
    x, y = np.ptp(odometry.poses[:, :2], axis=0)
    velocities = "with" if np.isfinite(odometry.twists).any() else "no"
    return _track_lines(
        "odometry",
        odometry,
        "poses",
        f"path {path_length(odometry.poses):.1f} m, net rotation {turned:.0f}°, "
        f"extent {x:.1f} × {y:.1f} m, {velocities} velocities",
    )


def _imu_lines(imu: ImuTrack) -> list[str]:
    values = {
        "orientation": imu.orientations,
        "angular velocity": imu.angular_velocities,
        "acceleration": imu.linear_accelerations,
    }
    present = ", ".join(name for name, rows in values.items() if np.isfinite(rows).any())
    known = "known" if imu.mounting_known else "not in the log"
    return _track_lines("IMU", imu, "readings", f"{present or 'no values'}; mounting {known}")
