"""The lines of a CARMEN log: one message a line, `NAME content… ipc_stamp host logger_stamp`.

This module parses the syntax; `jaxslam.io.carmen.reader` interprets the messages.
Format: http://carmen.sourceforge.net/logger_playback.html
"""

import gzip
import math
import re
import zlib
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from jaxtyping import Float64

from jaxslam.io.files import GZIP_MAGIC, read_head
from jaxslam.io.log import LogError

_NAME = re.compile(rb"[A-Z][A-Z0-9_]*")
_NO_POSE = (math.nan,) * 3
_STAMP_FIELDS = 3  # ipc stamp, host, logger stamp


class MessageStamps(NamedTuple):
    """The tail of every sensor message: `ipc` and `logger` are its two stamps in seconds."""

    ipc: float
    logger: float


class OdometryMessage(NamedTuple):
    """`ODOM x y theta tv rv accel`: pose in m and rad, velocities in m/s and rad/s."""

    line: int
    pose: tuple[float, ...]
    velocities: tuple[float, ...]
    stamp: MessageStamps


class LaserMessage(NamedTuple):
    """`FLASER`, `RAWLASER1` or `ROBOTLASER1`; missing values are NaN.

    Angles are in radians: `start` of the first beam, field of view `fov`, `step` between beams.
    """

    line: int
    ranges: Float64[np.ndarray, "B"]
    stamp: MessageStamps
    start: float = math.nan
    fov: float = math.nan
    step: float = math.nan
    range_max: float = math.nan
    pose_laser: tuple[float, ...] = _NO_POSE
    pose_robot: tuple[float, ...] = _NO_POSE
    velocities: tuple[float, ...] = (math.nan, math.nan)


@dataclass
class CarmenContent:
    """All messages of a log in the order of the file.

    Attributes:
        parameters: the last value of every `PARAM`, as text.
        odometry: the `ODOM` messages.
        lasers: messages of the front laser by name.
        counts: number of lines by message name, damaged ones included.
        damaged: numbers of the lines that are not complete messages.
        cut_at_end: whether the last line is damaged.
    """

    parameters: dict[str, str] = field(default_factory=dict)
    odometry: list[OdometryMessage] = field(default_factory=list)
    lasers: dict[str, list[LaserMessage]] = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)
    damaged: list[int] = field(default_factory=list)
    cut_at_end: bool = False


def read_messages(path: Path) -> CarmenContent:
    """Read all lines of a CARMEN log.

    Raises:
        LogError: the path is missing or a folder, or the file is empty, binary or an incomplete gzip file.
    """
    if path.is_dir():
        raise LogError(f"{path}: is a folder: give the log file itself")
    content = CarmenContent()
    number = 0
    try:
        with _open(path) as stream:
            for number, line in enumerate(stream, start=1):
                if b"\0" in line:
                    raise LogError(f"{path}: is not a text file: a CARMEN log has one message a line")
                _read_line(content, number, line)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        scans = sum(len(messages) for messages in content.lasers.values())
        name = path.name.removesuffix(".gz")
        raise LogError(
            f"{path}: the gzip file is cut short or damaged after {number} good lines with {scans} "
            f"scans ({error}): copy it again, or keep the good lines with "
            f"'gzip -dc {path.name} > {name}' and read {name}"
        ) from None
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror or error}") from None
    if number == 0:
        raise LogError(f"{path}: is empty")
    return content


def _open(path: Path) -> gzip.GzipFile | BinaryIO:
    return gzip.open(path, "rb") if read_head(path).startswith(GZIP_MAGIC) else path.open("rb")


def _read_line(content: CarmenContent, number: int, line: bytes) -> None:
    fields = line.split()
    if not fields or fields[0].startswith(b"#"):
        return
    content.cut_at_end = False
    if not _NAME.fullmatch(fields[0]):
        content.damaged.append(number)
        return
    name = fields[0].decode("ascii")
    content.counts[name] += 1
    try:
        if name == "PARAM":
            content.parameters[_text(fields[1])] = _text(fields[2])
        elif name == "ODOM":
            content.odometry.append(_parse_odometry(number, fields))
        elif name in _LASER_PARSERS:
            content.lasers.setdefault(name, []).append(_LASER_PARSERS[name](number, fields))
    except (ValueError, IndexError):
        content.damaged.append(number)
        content.cut_at_end = not line.endswith(b"\n")


def _text(field: bytes) -> str:
    return field.decode("utf-8", errors="replace")


def _finite(fields: list[bytes]) -> tuple[float, ...]:
    numbers = tuple(map(float, fields))
    if not np.isfinite(numbers).all():
        raise ValueError("not finite")
    return numbers


def _expect(fields: list[bytes], count: int) -> None:
    # A cut line, or two lines merged into one, has a different number of fields.
    if len(fields) != count:
        raise ValueError("wrong number of fields")


def _stamp(fields: list[bytes]) -> MessageStamps:
    return MessageStamps(*_finite([fields[-3], fields[-1]]))


def _readings(fields: list[bytes], first: int) -> tuple[Float64[np.ndarray, "B"], int]:
    """Parse the list `n r1 … rn` that starts at field `first`; also return the field after it."""
    count = int(fields[first])
    end = first + 1 + count
    if count < 0 or end > len(fields):
        raise ValueError("list is cut")
    return np.array(list(map(float, fields[first + 1 : end])), dtype=np.float64), end


def _parse_odometry(number: int, fields: list[bytes]) -> OdometryMessage:
    _expect(fields, 7 + _STAMP_FIELDS)
    return OdometryMessage(number, _finite(fields[1:4]), _finite(fields[4:6]), _stamp(fields))


def _parse_flaser(number: int, fields: list[bytes]) -> LaserMessage:
    """Parse `FLASER n r… laser_pose odom_pose`, the old message without beam geometry."""
    ranges, end = _readings(fields, 1)
    _expect(fields, end + 6 + _STAMP_FIELDS)
    poses = _finite(fields[end : end + 6])
    return LaserMessage(number, ranges, _stamp(fields), pose_laser=poses[:3], pose_robot=poses[3:])


def _parse_raw_laser(number: int, fields: list[bytes], num_more: int = 0) -> LaserMessage:
    """Parse `RAWLASER1 type start fov step max accuracy remission_mode n r… m s…`, then `num_more` fields."""
    ranges, end = _readings(fields, 8)
    _, end = _readings(fields, end)
    _expect(fields, end + num_more + _STAMP_FIELDS)
    start, fov, step, range_max = _finite(fields[2:6])
    return LaserMessage(number, ranges, _stamp(fields), start, fov, step, range_max)


def _parse_robot_laser(number: int, fields: list[bytes]) -> LaserMessage:
    """Parse RAWLASER1 fields, then `laser_pose robot_pose tv rv forward_safety side_safety turn_axis`."""
    message = _parse_raw_laser(number, fields, num_more=11)
    first = len(fields) - _STAMP_FIELDS - 11
    values = _finite(fields[first : first + 8])
    return message._replace(pose_laser=values[:3], pose_robot=values[3:6], velocities=values[6:])


_LASER_PARSERS = {
    "FLASER": _parse_flaser,
    "RAWLASER1": _parse_raw_laser,
    "ROBOTLASER1": _parse_robot_laser,
}
