"""Reader for CARMEN text logs (`.log`, `.clf`, also gzipped): front laser scans and odometry."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from jaxslam.io.carmen.geometry import RANGE_MIN, beam_angles, maximum_range, mounting
from jaxslam.io.carmen.messages import CarmenContent, LaserMessage, read_messages
from jaxslam.io.carmen.time import Message, choose_clock, is_still, merge_odometry, message_stamps
from jaxslam.io.log import LogError, OdometryTrack, ScanTrack, SensorLog, select_rows
from jaxslam.io.ranges import clean_ranges, pad_ranges
from jaxslam.io.stamps import sorting_order, spread_repeats

# In order of preference: messages with odometry and geometry, with odometry only, with geometry only.
_LASER_NAMES = ("ROBOTLASER1", "FLASER", "RAWLASER1")


def read_carmen(path: str | Path) -> SensorLog:
    """Read a CARMEN log.

    Supported are `ODOM`, `FLASER`, `RAWLASER1`, `ROBOTLASER1` and the `PARAM` values of the front
    laser; every other message is counted in `topics` and named in `warnings`. If there are several
    kinds of laser messages, the one with most information is used. The choice of stamps, beam angles,
    maximum range, mounting and odometry is described at `choose_clock`, `beam_angles`,
    `maximum_range`, `mounting` and `merge_odometry`.

    Repairs are counted in `warnings`: damaged lines are skipped, readings that are negative or not
    finite become NaN, jittering stamps are sorted, repeated stamps are spread up to the next one, and
    scans recorded twice are dropped.

    Args:
        path: the log, plain or gzipped whatever its suffix.

    Returns:
        The log; `odometry` or `scans` is None if the file has none.

    Raises:
        LogError: the file is missing, empty, binary or an incomplete gzip file; it has no supported
            message or more damaged lines than good ones; stamps jump back by more than a second.
    """
    path = Path(path)
    content = read_messages(path)
    warnings: list[str] = []
    name = _choose_laser(content)
    _check_content(path, content)
    lasers = content.lasers.get(name, [])
    clock = choose_clock(path, (content.odometry, lasers), warnings)
    lasers, laser_stamps = _sort_scans(lasers, clock, name, warnings)
    scans = _scan_track(lasers, laser_stamps, content.parameters, name, warnings) if lasers else None

    poses = _poses(lasers, "robot")
    from_scans = OdometryTrack(laser_stamps, poses, _twists(lasers, poses), name)
    from_scans = select_rows(from_scans, np.isfinite(poses).all(axis=1))
    stamps = message_stamps(content.odometry, clock)
    poses = np.array([message.pose for message in content.odometry], dtype=np.float64).reshape(-1, 3)
    from_lines = OdometryTrack(stamps, poses, _twists(content.odometry, poses), "ODOM")
    from_lines = select_rows(from_lines, sorting_order(stamps, "ODOM", warnings))
    odometry = merge_odometry(from_lines, from_scans, warnings)
    _warn_about_lines(content, warnings)
    return SensorLog(path, odometry, scans=scans, warnings=tuple(warnings), topics=dict(content.counts))


def _choose_laser(content: CarmenContent) -> str:
    counts = {name: len(content.lasers.get(name, ())) for name in _LASER_NAMES}
    enough = max(counts.values()) / 2
    return next((name for name in _LASER_NAMES if counts[name] > enough), _LASER_NAMES[0])


def _check_content(path: Path, content: CarmenContent) -> None:
    good = len(content.odometry) + sum(len(messages) for messages in content.lasers.values())
    if good == 0 or len(content.damaged) > good:
        where = f", the first in line {content.damaged[0]}" if content.damaged else ""
        raise LogError(
            f"{path}: {good} usable messages and {len(content.damaged)} damaged lines{where}: "
            "expected a CARMEN log with ODOM, FLASER, RAWLASER1 or ROBOTLASER1 lines"
        )


def _warn_about_lines(content: CarmenContent, warnings: list[str]) -> None:
    if content.damaged:
        end = "; the file ends in the middle of a line, was it cut?" if content.cut_at_end else ""
        warnings.append(
            f"{len(content.damaged)} damaged lines skipped, the first is line {content.damaged[0]}{end}"
        )


def _sort_scans(
    lasers: Sequence[LaserMessage], clock: str, name: str, warnings: list[str]
) -> tuple[list[LaserMessage], Float64[np.ndarray, "T"]]:
    filled = [message for message in lasers if message.ranges.size]
    if len(filled) < len(lasers):
        warnings.append(f"{len(lasers) - len(filled)} {name} lines without beams skipped")
    stamps = message_stamps(filled, clock)
    order = sorting_order(stamps, name, warnings)
    filled, stamps = [filled[row] for row in order], stamps[order]
    keep = [row for row in range(len(filled)) if row == 0 or not _same(filled[row - 1], filled[row])]
    if len(keep) < len(filled):
        warnings.append(f"{len(filled) - len(keep)} {name} lines recorded twice: one of each kept")
    stamps, moved = spread_repeats(stamps[np.array(keep, dtype=np.int64)])
    if moved:
        warnings.append(f"{moved} scans have the stamp of the scan before: spread up to the next stamp")
    return [filled[row] for row in keep], stamps


def _same(first: LaserMessage, second: LaserMessage) -> bool:
    return (
        first.stamp == second.stamp
        and first.pose_robot == second.pose_robot
        and np.array_equal(first.ranges, second.ranges, equal_nan=True)
    )


def _scan_track(
    lasers: Sequence[LaserMessage],
    stamps: Float64[np.ndarray, "T"],
    parameters: dict[str, str],
    name: str,
    warnings: list[str],
) -> ScanTrack:
    ranges, num_beams = pad_ranges([message.ranges for message in lasers])
    present = np.arange(ranges.shape[1]) < num_beams[:, None]
    bad = int(np.count_nonzero(present & ~(np.isfinite(ranges) & (ranges >= 0))))
    if bad:
        warnings.append(f"{bad} readings are negative or not finite: taken as no return")
    range_max = maximum_range(lasers, ranges, parameters, warnings)
    pose, known = mounting(_poses(lasers, "robot"), _poses(lasers, "laser"), parameters, warnings)
    angles = np.array([beam_angles(message, parameters) for message in lasers])
    cleaned = clean_ranges(ranges, RANGE_MIN, range_max)
    if not np.isfinite(cleaned).any():
        warnings.append(f"no scan has a return between {RANGE_MIN:g} and {range_max:g} m")
    return ScanTrack(
        stamps,
        cleaned,
        num_beams,
        angles[:, 0],
        angles[:, 1],
        RANGE_MIN,
        range_max,
        pose,
        known,
        name,
    )


def _poses(lasers: Sequence[LaserMessage], whose: str) -> Float64[np.ndarray, "T 3"]:
    poses = [getattr(message, f"pose_{whose}") for message in lasers]
    return np.array(poses, dtype=np.float64).reshape(-1, 3)


def _twists(messages: Sequence[Message], poses: Float64[np.ndarray, "M 3"]) -> Float64[np.ndarray, "M 3"]:
    """Return base-frame velocities; NaN if all fields are zero although the robot moves."""
    velocities = np.array([message.velocities for message in messages], dtype=np.float64).reshape(-1, 2)
    if velocities.size and not velocities.any() and not is_still(poses):
        velocities[:] = np.nan
    side = np.where(np.isnan(velocities[:, 0]), np.nan, 0.0)
    return np.stack([velocities[:, 0], side, velocities[:, 1]], axis=1)
