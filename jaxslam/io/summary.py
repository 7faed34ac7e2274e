"""Text summary of a log: `jaxslam info LOG`."""

import textwrap
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

from jaxslam.core.trajectory import net_rotation, path_length
from jaxslam.io.gps import east_north
from jaxslam.io.log import FixTrack, ImuTrack, JointTrack, OdometryTrack, ScanTrack, SensorLog

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
    lines += _scan_lines(log.scans)
    lines += _odometry_lines(log.odometry)
    lines += _imu_lines(log.imu)
    lines += _joint_lines(log.joints)
    lines += _fix_lines(log.fixes)
    used = _used_topics(log)
    unused = [f"{topic} ({count})" for topic, count in log.topics.items() if topic not in used]
    lines += _wrap("not used", ", ".join(unused) or "none")
    for number, warning in enumerate(log.warnings):
        lines += _wrap("warnings" if number == 0 else "", f"- {warning}", hang=2)
    if not log.warnings:
        lines += _wrap("warnings", "none")
    return "\n".join(lines)


def _used_topics(log: SensorLog) -> set[str]:
    tracks = (log.odometry, log.imu, log.joints, log.fixes, log.scans)
    used = {name for track in tracks if track is not None for name in track.topic.split(" and ")}
    # A CARMEN log's parameters and a bag's static transforms are used in the tracks.
    return used | {"PARAM"} | {topic for topic in log.topics if topic.endswith("tf_static")}


def _wrap(label: str, text: str, hang: int = 0) -> list[str]:
    return textwrap.wrap(
        text,
        width=_WIDTH,
        initial_indent=f"{label:<{_INDENT}}",
        subsequent_indent=" " * (_INDENT + hang),
        break_on_hyphens=False,
    )


def _timing(stamps: Float64[np.ndarray, "M"], topic: str, unit: str) -> str:
    text = f"{stamps.size} {unit} on {topic}"
    if stamps.size < 2 or stamps[-1] == stamps[0]:
        return text
    duration = stamps[-1] - stamps[0]
    return f"{text}, {duration:.1f} s, {(stamps.size - 1) / duration:.2f} Hz"


def _gap_lines(stamps: Float64[np.ndarray, "M"]) -> list[str]:
    steps = np.diff(stamps)
    if steps.size == 0:
        return []
    largest = np.argsort(-steps, kind="stable")[:_NUM_GAPS]
    gaps = [row for row in largest if steps[row] > _GAP_PERIODS * np.median(steps)]
    if not gaps:
        return _wrap("", f"gaps: none over {_GAP_PERIODS:g} periods (largest {steps.max():.3g} s)")
    listed = ", ".join(f"{steps[row]:.3g} s after {stamps[row] - stamps[0]:.1f} s" for row in gaps)
    return _wrap("", f"gaps: {listed}")


def _interval(values: Float64[np.ndarray, "T"] | Sequence[int], form: str) -> str:
    low, high = f"{min(values):{form}}", f"{max(values):{form}}"
    return low if low == high else f"{low} to {high}"


def _scan_lines(scans: ScanTrack | None) -> list[str]:
    if scans is None:
        return _wrap("scans", "none")
    step = np.rad2deg(scans.angle_increment)
    first = np.rad2deg(scans.angle_min)
    span = np.abs(step) * (scans.num_beams - 1)
    total = int(scans.num_beams.sum())
    share = np.count_nonzero(np.isfinite(scans.ranges)) / max(total, 1)
    lines = _wrap("scans", _timing(scans.stamps, scans.topic, "scans"))
    lines += _wrap(
        "",
        f"{_interval(scans.num_beams.tolist(), 'd')} beams, {_interval(step, '.3f')}° apart from "
        f"{_interval(first, '.1f')}° on, over {_interval(span, '.1f')}°",
    )
    lines += _wrap(
        "",
        f"sensor {scans.range_min:.4g} to {scans.range_max:.4g} m; {_range_text(scans)}"
        f"{share:.1%} of the beams have a return",
    )
    x, y, theta = scans.pose_base_lidar
    source = "" if scans.mounting_known else " (assumed: not in the log)"
    angle = np.rad2deg(theta)
    lines += _wrap("", f"lidar at x {x:.3f} m, y {y:.3f} m, heading {angle:.1f}°{source}")
    return lines + _gap_lines(scans.stamps)


def _range_text(scans: ScanTrack) -> str:
    finite = scans.ranges[np.isfinite(scans.ranges)]
    if finite.size == 0:
        return ""
    low, middle, high = np.percentile(finite, [0, 50, 100])
    return f"measured {low:.2f} to {high:.2f} m, median {middle:.2f} m; "


def _odometry_lines(odometry: OdometryTrack | None) -> list[str]:
    if odometry is None:
        return _wrap("odometry", "none")
    lines = _wrap("odometry", _timing(odometry.stamps, odometry.topic, "poses"))
    turned = np.rad2deg(net_rotation(odometry.poses))
    extent = np.ptp(odometry.poses[:, :2], axis=0)
    lines += _wrap(
        "",
        f"path {path_length(odometry.poses):.1f} m, net rotation {turned:.0f}°, "
        f"extent {extent[0]:.1f} × {extent[1]:.1f} m, "
        f"{'with' if np.isfinite(odometry.twists).any() else 'no'} velocities",
    )
    return lines + _gap_lines(odometry.stamps)


def _imu_lines(imu: ImuTrack | None) -> list[str]:
    if imu is None:
        return []
    lines = _wrap("IMU", _timing(imu.stamps, imu.topic, "readings"))
    has = [
        name
        for name, values in (
            ("orientation", imu.orientations),
            ("angular velocity", imu.angular_velocities),
            ("acceleration", imu.linear_accelerations),
        )
        if np.isfinite(values).any()
    ]
    known = "known" if imu.mounting_known else "not in the log"
    lines += _wrap("", f"{', '.join(has) or 'no values'}; mounting {known}")
    return lines + _gap_lines(imu.stamps)


def _joint_lines(joints: JointTrack | None) -> list[str]:
    if joints is None:
        return []
    lines = _wrap("joints", _timing(joints.stamps, joints.topic, "readings"))
    lines += _wrap("", ", ".join(joints.names) or "no names")
    return lines + _gap_lines(joints.stamps)


def _fix_lines(fixes: FixTrack | None) -> list[str]:
    if fixes is None:
        return []
    lines = _wrap("GPS", _timing(fixes.stamps, fixes.topic, "fixes"))
    east, north = np.ptp(east_north(fixes.positions), axis=0)
    lines += _wrap("", f"extent {east:.0f} m east × {north:.0f} m north")
    return lines + _gap_lines(fixes.stamps)
