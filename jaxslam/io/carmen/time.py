"""The clock of a CARMEN log, and one odometry track from its ODOM lines and its scans."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64

from jaxslam.core import se2
from jaxslam.core.trajectory import interpolate_poses
from jaxslam.io.carmen.messages import LaserMessage, OdometryMessage
from jaxslam.io.log import LogError, OdometryTrack
from jaxslam.io.stamps import MAX_BACKWARD_S, backward_steps

Message = LaserMessage | OdometryMessage

# ODOM lines on another clock than the scans: CARMEN estimates the skew and puts it right in the
# poses of the scans, not in the stamps. Half a centimeter is above the rounding of any log.
_AGREEMENT = (0.005, 0.005)


class ClockChoice(NamedTuple):
    """Which of the two stamps of a message is used: `ipc` or `logger`, and a warning or None."""

    name: str
    warning: str | None


def message_stamps(messages: Sequence[Message], clock: str) -> Float64[np.ndarray, "M"]:
    """Stamp `[M]` in seconds by one of the two clocks, `ipc` or `logger`."""
    return np.array([getattr(message.stamp, clock) for message in messages], dtype=np.float64)


def choose_clock(path: str, streams: Sequence[Sequence[Message]]) -> ClockChoice:
    """Pick the clock of a log: the ipc stamp unless it is unusable.

    The ipc stamp is the time of the measurement, by the clock of the computer that took it, and
    ground-truth relations use it; the logger stamp is the time of arrival, and has jitter. The
    logger stamp is used where the ipc stamps stand still (old logs have zeros), run back by more
    than a second, or differ between odometry and scans by more than a second against the logger.

    Args:
        path: for the error message.
        streams: messages by kind, odometry and scans; empty ones are ignored.

    Raises:
        LogError: neither clock is usable; names the line where it jumps.
    """
    used = [messages for messages in streams if messages]
    ipc_fault = _fault(used, "ipc")
    logger_fault = _fault(used, "logger")
    if ipc_fault is None and logger_fault is None and len(used) > 1:
        skews = [
            np.median(message_stamps(messages, "ipc") - message_stamps(messages, "logger"))
            for messages in used
        ]
        if np.ptp(skews) > MAX_BACKWARD_S:
            ipc_fault = f"the odometry's and the scans' clocks are {np.ptp(skews):.1f} s apart"
    if ipc_fault is None:
        return ClockChoice("ipc", None)
    if logger_fault is None:
        return ClockChoice("logger", f"logger stamps used: {ipc_fault}")
    raise LogError(f"{path}: no usable time stamps: {ipc_fault}: cut the log there or stamp it again")


def _fault(streams: Sequence[Sequence[Message]], clock: str) -> str | None:
    for messages in streams:
        stamps = message_stamps(messages, clock)
        if stamps.size > 1 and np.ptp(stamps) == 0:
            return f"all {clock} stamps are {stamps[0]:g}"
        steps = backward_steps(stamps)
        if steps.largest > MAX_BACKWARD_S:
            line = messages[steps.row].line
            return f"{clock} stamps run back by {steps.largest:.1f} s at line {line}"
    return None


def merge_odometry(
    lines: tuple[Float64[np.ndarray, "M"], Float64[np.ndarray, "M 3"], Float64[np.ndarray, "M 3"]],
    scans: tuple[Float64[np.ndarray, "T"], Float64[np.ndarray, "T 3"], Float64[np.ndarray, "T 3"]],
    scan_name: str,
) -> tuple[OdometryTrack | None, str | None]:
    """Merge ODOM lines and the poses stored with the scans into one odometry track.

    A scan's own pose is the best statement of where the robot was when it was taken, since CARMEN
    interpolates it and corrects the skew between the computers' clocks. So it always wins at the
    stamp of its scan. ODOM lines fill in between where they agree with the scans' poses on time (at
    the scans' stamps, median over the moving scans within 5 mm and 5 mrad); where they do not,
    mixing the two would make the robot jump to and fro, and the ODOM lines are left out. Scans
    whose poses never change while the ODOM lines do have no odometry of their own.

    Args:
        lines: stamps `[M]` (sorted), poses `[M, 3]` and twists `[M, 3]` of the ODOM lines.
        scans: the same of the scans, without those that have no pose.
        scan_name: message name of the scans.

    Returns:
        The track, None where there is neither; and a warning or None.
    """
    lines, scans = _without_repeats(*lines), _without_repeats(*scans)
    if scans[0].size == 0 and lines[0].size == 0:
        return None, None
    if scans[0].size == 0:
        return OdometryTrack(*lines, topic="ODOM"), None
    if lines[0].size == 0:
        return OdometryTrack(*scans, topic=scan_name), None
    if _still(scans[1]) and not _still(lines[1]):
        return OdometryTrack(*lines, topic="ODOM"), (
            f"the odometry poses in {scan_name} never change: ODOM lines used instead"
        )
    distance = _disagreement(lines, scans)
    if distance is not None:
        return OdometryTrack(*scans, topic=scan_name), (
            f"ODOM lines left out: at the times of the scans they are {distance * 1000:.0f} mm "
            f"(median) off the odometry poses in {scan_name}, which are used instead"
        )
    keep = ~np.isin(lines[0], scans[0])
    # FLASER has no velocities; those of the ODOM line with the same stamp hold for it too.
    _, in_lines, in_scans = np.intersect1d(lines[0], scans[0], return_indices=True)
    scan_twists = scans[2].copy()
    missing = np.isnan(scan_twists[in_scans])
    scan_twists[in_scans] = np.where(missing, lines[2][in_lines], scan_twists[in_scans])
    stamps = np.concatenate([lines[0][keep], scans[0]])
    poses = np.concatenate([lines[1][keep], scans[1]])
    twists = np.concatenate([lines[2][keep], scan_twists])
    order = np.argsort(stamps, kind="stable")
    topic = f"ODOM and {scan_name}"
    return OdometryTrack(stamps[order], poses[order], twists[order], topic), None


def _without_repeats(
    stamps: Float64[np.ndarray, "M"],
    poses: Float64[np.ndarray, "M 3"],
    twists: Float64[np.ndarray, "M 3"],
) -> tuple[Float64[np.ndarray, "N"], Float64[np.ndarray, "N 3"], Float64[np.ndarray, "N 3"]]:
    last = np.append(np.diff(stamps) > 0, True)[: stamps.size]
    return stamps[last], poses[last], twists[last]


def _still(poses: Float64[np.ndarray, "M 3"]) -> bool:
    return bool((poses == poses[0]).all())


def _disagreement(
    lines: tuple[Float64[np.ndarray, "M"], Float64[np.ndarray, "M 3"], Float64[np.ndarray, "M 3"]],
    scans: tuple[Float64[np.ndarray, "T"], Float64[np.ndarray, "T 3"], Float64[np.ndarray, "T 3"]],
) -> float | None:
    """Return the median distance in meters between ODOM and scan poses if it is too large, else None."""
    inside = (scans[0] >= lines[0][0]) & (scans[0] <= lines[0][-1])
    moving = inside & np.append(False, (np.diff(scans[1], axis=0) != 0).any(axis=1))
    if not moving.any():
        return None
    expected = interpolate_poses(lines[0], lines[1], scans[0][moving])
    distance = float(np.median(np.linalg.norm(expected[:, :2] - scans[1][moving, :2], axis=1)))
    rotation = float(np.median(np.abs(se2.wrap(expected[:, 2] - scans[1][moving, 2]))))
    return distance if distance > _AGREEMENT[0] or rotation > _AGREEMENT[1] else None
