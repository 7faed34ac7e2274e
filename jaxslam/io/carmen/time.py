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

# If ODOM lines and scans have different clocks, CARMEN estimates the skew and corrects the poses of
# the scans, but not their stamps. Half a centimeter is above the rounding of any log.
_AGREEMENT = (0.005, 0.005)


class ClockChoice(NamedTuple):
    """The chosen stamp of the messages, `ipc` or `logger`, and a warning or None."""

    name: str
    warning: str | None


def message_stamps(messages: Sequence[Message], clock: str) -> Float64[np.ndarray, "M"]:
    """Stamp `[M]` in seconds by one of the two clocks, `ipc` or `logger`."""
    return np.array([getattr(message.stamp, clock) for message in messages], dtype=np.float64)


def choose_clock(path: str, streams: Sequence[Sequence[Message]]) -> ClockChoice:
    """Choose the clock of a log: the ipc stamp unless it is unusable.

    The ipc stamp is the time of the measurement, on the clock of the measuring computer, and
    ground-truth relations use it. The logger stamp is the time of arrival, with jitter. The logger
    stamp is used if the ipc stamps are constant (old logs have zeros), run back by more than a second,
    or if their offset to the logger differs between odometry and scans by more than a second.

    Args:
        path: for the error message.
        streams: messages by kind, odometry and scans; empty ones are ignored.

    Raises:
        LogError: neither clock is usable; the message has the line of the jump.
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

    The pose stored with a scan is the best estimate of the robot's pose at its stamp, because CARMEN
    interpolates it and corrects the skew between the computers' clocks. So it always has priority at
    the stamp of the scan. ODOM lines fill the gaps if they agree with the scans' poses (at the scans'
    stamps, the median over the moving scans is within 5 mm and 5 mrad). If they disagree, a mixture
    would make the robot jump back and forth, so the ODOM lines are left out. If the poses of the scans
    never change but the ODOM lines do, the scans have no odometry, and only the ODOM lines are used.

    Args:
        lines: stamps `[M]` (sorted), poses `[M, 3]` and twists `[M, 3]` of the ODOM lines.
        scans: the same of the scans with a pose.
        scan_name: message name of the scans.

    Returns:
        The track, None if there is no pose at all; and a warning or None.
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
    # FLASER has no velocities: take them from the ODOM line with the same stamp.
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
