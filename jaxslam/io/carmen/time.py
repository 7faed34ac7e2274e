"""The clock of a CARMEN log, and one odometry track from its ODOM lines and its scans."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from jaxslam.core import se2
from jaxslam.core.trajectory import interpolate_poses
from jaxslam.io.carmen.messages import LaserMessage, OdometryMessage
from jaxslam.io.log import LogError, OdometryTrack, select_rows
from jaxslam.io.stamps import MAX_BACKWARD_S, largest_step_back

Message = LaserMessage | OdometryMessage

# If ODOM lines and scans have different clocks, CARMEN estimates the skew and corrects the poses of
# the scans, but not their stamps. Half a centimeter is above the rounding of any log.
_AGREEMENT = (0.005, 0.005)


def message_stamps(messages: Sequence[Message], clock: str) -> Float64[np.ndarray, "M"]:
    """Stamp `[M]` in seconds by one of the two clocks, `ipc` or `logger`."""
    return np.array([getattr(message.stamp, clock) for message in messages], dtype=np.float64)


def choose_clock(path: Path, streams: Sequence[Sequence[Message]], warnings: list[str]) -> str:
    """Choose the clock of a log, `ipc` or `logger`: the ipc stamp unless it is unusable.

    The ipc stamp is the time of the measurement, on the clock of the measuring computer, and ground-truth
    relations use it. The logger stamp is the time of arrival, with jitter. The logger stamp is used if the
    ipc stamps are constant (old logs have zeros), jump back by more than a second, or if their offset to the
    logger differs between odometry and scans by more than a second.

    Args:
        path: for the error message.
        streams: messages by kind, odometry and scans; empty ones are ignored.
        warnings: list to which a line is appended if the logger stamp is used.

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
        return "ipc"
    if logger_fault is None:
        warnings.append(f"logger stamps used: {ipc_fault}")
        return "logger"
    raise LogError(f"{path}: no usable time stamps: {ipc_fault}: cut the log there or stamp it again")


def _fault(streams: Sequence[Sequence[Message]], clock: str) -> str | None:
    for messages in streams:
        stamps = message_stamps(messages, clock)
        if stamps.size > 1 and np.ptp(stamps) == 0:
            return f"all {clock} stamps are {stamps[0]:g}"
        largest, row = largest_step_back(stamps)
        if largest > MAX_BACKWARD_S:
            return f"{clock} stamps run backwards by {largest:.1f} s at line {messages[row].line}"
    return None


def merge_odometry(lines: OdometryTrack, scans: OdometryTrack, warnings: list[str]) -> OdometryTrack | None:
    """Merge ODOM lines and the poses stored with the scans into one odometry track.

    The pose stored with a scan is the best estimate of the robot's pose at its stamp, because CARMEN
    interpolates it and corrects the skew between the computers' clocks. So it always has priority at
    the stamp of the scan. ODOM lines fill the gaps if they agree with the scans' poses (at the scans'
    stamps, the median over the moving scans is within 5 mm and 5 mrad). If they disagree, a mixture
    would make the robot jump back and forth, so the ODOM lines are left out. If the poses of the scans
    never change but the ODOM lines do, the scans have no odometry, and only the ODOM lines are used.

    Args:
        lines: track of the ODOM lines, possibly empty, with sorted stamps.
        scans: track of the poses stored with the scans, likewise.
        warnings: list to which a line is appended if one of the two is left out.

    Returns:
        The track; None if there is no pose at all.
    """
    lines, scans = _without_repeats(lines), _without_repeats(scans)
    if scans.stamps.size == 0:
        return lines if lines.stamps.size else None
    if lines.stamps.size == 0:
        return scans
    if is_still(scans.poses) and not is_still(lines.poses):
        warnings.append(f"the odometry poses in {scans.topic} never change: ODOM lines used instead")
        return lines
    distance = _disagreement(lines, scans)
    if distance is not None:
        warnings.append(
            f"ODOM lines left out: at the times of the scans they are {distance * 1000:.0f} mm "
            f"(median) off the odometry poses in {scans.topic}, which are used instead"
        )
        return scans
    # FLASER has no velocities: take them from the ODOM line with the same stamp.
    _, in_lines, in_scans = np.intersect1d(lines.stamps, scans.stamps, return_indices=True)
    twists = scans.twists.copy()
    twists[in_scans] = np.where(np.isnan(twists[in_scans]), lines.twists[in_lines], twists[in_scans])
    kept = select_rows(lines, ~np.isin(lines.stamps, scans.stamps))
    merged = OdometryTrack(
        np.concatenate([kept.stamps, scans.stamps]),
        np.concatenate([kept.poses, scans.poses]),
        np.concatenate([kept.twists, twists]),
        f"{lines.topic} and {scans.topic}",
    )
    return select_rows(merged, np.argsort(merged.stamps, kind="stable"))


def _without_repeats(track: OdometryTrack) -> OdometryTrack:
    """Keep the last of the poses with the same stamp."""
    return select_rows(track, np.append(np.diff(track.stamps) > 0, True)[: track.stamps.size])


def is_still(poses: Float64[np.ndarray, "M 3"]) -> bool:
    """Return whether all poses are the same."""
    return bool((poses == poses[0]).all())


def _disagreement(lines: OdometryTrack, scans: OdometryTrack) -> float | None:
    """Return the median distance in meters between ODOM and scan poses if it is too large, else None."""
    inside = (scans.stamps >= lines.stamps[0]) & (scans.stamps <= lines.stamps[-1])
    moving = inside & np.append(False, (np.diff(scans.poses, axis=0) != 0).any(axis=1))
    if not moving.any():
        return None
    expected = interpolate_poses(lines.stamps, lines.poses, scans.stamps[moving])
    difference = expected - scans.poses[moving]
    distance = float(np.median(np.linalg.norm(difference[:, :2], axis=1)))
    rotation = float(np.median(np.abs(se2.wrap(difference[:, 2]))))
    return distance if distance > _AGREEMENT[0] or rotation > _AGREEMENT[1] else None
