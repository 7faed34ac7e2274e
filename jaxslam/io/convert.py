"""Conversion of public logs into the files that jaxslam reads: CARMEN text, relations, TUM, map_server.

Every converted file is written under a temporary name and then renamed, so an interrupted conversion leaves
no half file. The same sources give the same bytes.
"""

import gzip
import math
import os
import shutil
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from jaxslam.core import se2
from jaxslam.io.files import GZIP_MAGIC
from jaxslam.io.log import LogError
from jaxslam.io.map_server import write_map
from jaxslam.io.public_logs import Conversion
from jaxslam.io.relations import read_relations
from jaxslam.io.stamps import nearest_rows
from jaxslam.io.tum import write_tum

_NO_OFFSET = "PARAM robot_frontlaser_offset 0 nohost 0"

INTEL_FIRST_STAMP = 976052857.3373
"""Stamp of the benchmark's relations at time 0 of `intel.gfs.log`, seconds."""
_INTEL_PERIOD = 0.2
_INTEL_TOLERANCE = 0.01  # The log has six digits, a hundredth of a second after 1000 s.

# Mines ParisTech's robot, as tinySLAM's own test program has it.
_TICK = 0.077 * 2 * math.pi / 2000
_HALF_TRACK = 0.165
_MINES_LIDAR_OFFSET = 0.145
_MINES_BEAMS = 682
_MINES_GEOMETRY = "-2.094395 4.188790 0.006151 5.600 0.010000 0"

_WEAN_OCCUPIED, _WEAN_FREE = 0.35, 0.8  # Bounds of the probability that a cell is free.


def convert(conversion: Conversion, name: str, sources: Sequence[Path], folder: Path) -> list[Path]:
    """Convert the downloaded files of a public log.

    Args:
        conversion: how to convert.
        name: name of the log; the converted files begin with it where there is only one log.
        sources: the downloaded files, in the order of the registry.
        folder: folder for the converted files.

    Returns:
        The converted files, the first log first.

    Raises:
        LogError: a source is not of the expected format.
    """
    try:
        return _CONVERSIONS[conversion](name, sources, folder)
    except (ValueError, IndexError) as error:
        if isinstance(error, LogError):
            raise
        raise LogError(f"{sources[0].parent}: a file does not have the expected format: {error}") from None


def _copy(name: str, sources: Sequence[Path], folder: Path) -> list[Path]:
    return [_written(folder / source.name, partial(shutil.copyfile, source)) for source in sources]


def _corrected(name: str, sources: Sequence[Path], folder: Path) -> list[Path]:
    """Keep the scans and parameters of a corrected log, and relations with the same time base.

    The odometry lines between the scans are left out, because their poses jump at every correction. The laser
    poses are the trajectory of the program that corrected the log; they become a reference in TUM format.
    """
    lines = [
        line for line in _read_lines(sources[0]) if line.startswith(("PARAM ", "FLASER ", "ROBOTLASER1 "))
    ]
    log = _write_log(folder / f"{name}.clf.gz", lines)
    stamps, poses = _laser_poses(lines, sources[0])
    written = [log, _write_reference(folder / f"{name}.reference.tum", stamps, poses)]
    for source in sources[1:]:
        relations = read_relations(source)
        inside = (relations.stamps_from >= stamps.min() - 1) & (relations.stamps_to <= stamps.max() + 1)
        if inside.mean() > 0.5:  # Else the corrected log has another time base than the benchmark's.
            written += _copy(name, [source], folder)
    return written


def _gfs(name: str, sources: Sequence[Path], folder: Path) -> list[Path]:
    """Read raw odometry and scans from a gfs file; its particles are skipped."""
    lines = [_NO_OFFSET]
    for fields in _read_fields(sources[0], "ODOM", "LASER_READING"):
        *values, x, y, theta, stamp = fields[1:]
        pose = f"{x} {y} {theta}"
        if fields[0] == "ODOM":
            lines.append(_odom_line(pose, stamp))
        else:
            lines.append(_flaser_line(" ".join(values), pose, pose, stamp))
    corrected = [line for line in _read_lines(sources[1]) if line.startswith("FLASER ")]
    return [
        _write_log(folder / f"{name}.clf.gz", lines),
        _write_reference(folder / f"{name}.reference.tum", *_laser_poses(corrected, sources[1])),
    ]


def _gfs_log(name: str, sources: Sequence[Path], folder: Path) -> list[Path]:
    """Recover the raw odometry of a log whose odometry starts anew from the corrected pose after every scan.

    After a scan the source has an `ODOM` line of stamp 0 with the corrected pose, and the following `ODOM`
    lines add the raw motion to it. The raw poses are these motions chained. The source's stamps jitter by up
    to a second and run backwards, so reading i gets the time 0.2 s · i, in the log and in the relations.
    """
    lines = [_NO_OFFSET]
    stamps: list[float] = []
    raw, previous, time = np.zeros(3), np.zeros(3), "0.0"
    for fields in _read_fields(sources[0], "ODOM", "FLASER"):
        if fields[0] == "FLASER":  # Taken at the reading before it.
            lines.append(_flaser_line(" ".join(fields[1:-9]), _pose_text(raw), _pose_text(raw), time))
            continue
        pose, stamp = np.array(fields[1:4], dtype=np.float64), float(fields[7])
        if stamp != 0:
            raw = se2.compose(raw, se2.relative(previous, pose)) if stamps else pose
            time = f"{len(stamps) * _INTEL_PERIOD:.1f}"
            stamps.append(stamp)
            lines.append(_odom_line(_pose_text(raw), time))
        previous = pose
    return [
        _write_log(folder / f"{name}.clf.gz", lines),
        _restamp_relations(sources[1], np.array(stamps), folder / f"{name}.relations"),
    ]


def _restamp_relations(source: Path, stamps: np.ndarray, path: Path) -> Path:
    """Give the relations the time of the reading with the same stamp."""
    rows = [line.split() for line in _read_lines(source) if line.strip() and not line.startswith("#")]
    wanted = np.array([row[:2] for row in rows], dtype=np.float64).reshape(-1, 2) - INTEL_FIRST_STAMP
    order = np.argsort(stamps, kind="stable")
    nearest = order[nearest_rows(stamps[order], wanted)]
    found = (np.abs(stamps[nearest] - wanted) <= _INTEL_TOLERANCE).all(axis=1)
    kept = [
        f"{start:.1f} {end:.1f} {' '.join(row[2:])}"
        for row, (start, end), good in zip(rows, nearest * _INTEL_PERIOD, found, strict=True)
        if good and len(row) == 8
    ]
    if 2 * len(kept) < len(rows) or not kept:
        raise LogError(f"{source}: only {len(kept)} of {len(rows)} relations have stamps of the log")
    return _written(path, lambda part: part.write_text("\n".join(kept) + "\n", encoding="ascii"))


def _tinyslam(name: str, sources: Sequence[Path], folder: Path) -> list[Path]:
    """Convert `stamp_us · left right …20 more… 682 ranges_mm` lines: wheel ticks become odometry poses."""
    written = []
    for source in sources:
        lines: list[str] = []
        pose, ticks, start = np.zeros(3), np.zeros(2), 0.0
        for fields in (line.split() for line in _read_lines(source) if line.strip()):
            if len(fields) != 24 + _MINES_BEAMS:
                raise LogError(f"{source}: a line has {len(fields)} numbers, expected {24 + _MINES_BEAMS}")
            stamp, now = float(fields[0]) / 1e6, np.array(fields[2:4], dtype=np.float64)
            if not lines:
                start, ticks = stamp, now
            left, right = (now - ticks) * _TICK
            turn = (right - left) / (2 * _HALF_TRACK)
            # The chord of the arc driven has the heading of its middle.
            step = np.array(
                [(left + right) / 2 * math.cos(turn / 2), (left + right) / 2 * math.sin(turn / 2), turn]
            )
            pose, ticks = se2.compose(pose, step), now
            laser = se2.compose(pose, np.array([_MINES_LIDAR_OFFSET, 0.0, 0.0]))
            ranges = " ".join(f"{float(field) / 1000:.3f}" for field in fields[24:])
            time = f"{stamp - start:.6f}"
            lines.append(_odom_line(_pose_text(pose), time))
            lines.append(
                f"ROBOTLASER1 0 {_MINES_GEOMETRY} {_MINES_BEAMS} {ranges} 0 {_pose_text(laser)} "
                f"{_pose_text(pose)} 0 0 0.2 0.2 1000000 {time} nohost {time}"
            )
        written.append(_write_log(folder / f"{name}_{source.stem}.clf.gz", lines))
    return written


def _wean(name: str, sources: Sequence[Path], folder: Path) -> list[Path]:
    """Convert the map, and logs with `O pose t` and `L pose laser_pose ranges t` lines in centimeters."""
    map_path, *logs = sources
    written = []
    for source in logs:
        lines = ["PARAM robot_frontlaser_offset 0.25 nohost 0"]
        for fields in _read_fields(source, "O", "L"):
            values = np.array(fields[1:], dtype=np.float64)
            time = f"{values[-1]:.6f}"
            robot = _pose_text(values[:3] * _CM)
            if fields[0] == "O":
                lines.append(_odom_line(robot, time))
            else:
                ranges = " ".join(f"{reading / 100:.3f}" for reading in values[6:-1])
                laser = _pose_text(values[3:6] * _CM)
                lines.append(_flaser_line(f"{values.size - 7} {ranges}", laser, robot, time))
        written.append(_write_log(folder / f"{name}_{source.name.partition('.')[0]}.clf.gz", lines))
    return [*written, _wean_map(map_path, folder / f"{name}.yaml")]


_CM = np.array([0.01, 0.01, 1.0])
"""Factors of a pose in centimeters and radians."""


def _wean_map(source: Path, path: Path) -> Path:
    """Convert a grid of the probability that a cell is free, one line per x; a negative value is unknown."""
    header, _, cells = "\n".join(_read_lines(source)).partition("global_map[0]:")
    settings = dict(line.split() for line in header.splitlines() if len(line.split()) == 2)
    numbers = np.array(cells.split(), dtype=np.float64)
    resolution = settings.get("robot_specifications->resolution")
    if resolution is None or numbers.size < 3 or numbers.size - 2 != numbers[0] * numbers[1]:
        raise LogError(f"{source}: expected a resolution and `global_map[0]: rows columns` with its cells")
    free = numbers[2:].reshape(int(numbers[0]), int(numbers[1])).T
    occupied = np.select([free < 0, free < _WEAN_OCCUPIED, free > _WEAN_FREE], [np.nan, 1.0, 0.0], np.nan)
    write_map(path, occupied, float(resolution) / 100)
    return path


_CONVERSIONS: dict[Conversion, Callable[[str, Sequence[Path], Path], list[Path]]] = {
    "copy": _copy,
    "corrected": _corrected,
    "gfs": _gfs,
    "gfs_log": _gfs_log,
    "tinyslam": _tinyslam,
    "wean": _wean,
}


def _read_lines(path: Path) -> list[str]:
    content = path.read_bytes()
    try:
        text = gzip.decompress(content) if content.startswith(GZIP_MAGIC) else content
    except (OSError, EOFError):
        raise LogError(f"{path}: the gzip file is damaged: remove it and fetch the log again") from None
    return text.decode("utf-8", errors="replace").splitlines()


def _read_fields(path: Path, *names: str) -> list[list[str]]:
    rows = [line.split() for line in _read_lines(path) if line.split(" ", 1)[0] in names]
    if len({row[0] for row in rows}) < len(names):
        raise LogError(f"{path}: expected lines that begin with {' and '.join(names)}")
    return rows


def _laser_poses(lines: Iterable[str], source: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return stamps `[T]` and laser poses `[T, 3]` of `FLASER` or `ROBOTLASER1` lines, sorted by time."""
    rows = [line.split() for line in lines if not line.startswith("PARAM ")]
    if not rows:
        raise LogError(f"{source}: expected lines that begin with FLASER or ROBOTLASER1")
    # From the end: FLASER has two poses and three stamp fields, ROBOTLASER1 five more numbers between them.
    starts = [-9 if row[0] == "FLASER" else -14 for row in rows]
    poses = [row[start : start + 3] for row, start in zip(rows, starts, strict=True)]
    stamps = np.array([row[-3] for row in rows], dtype=np.float64)
    order = np.argsort(stamps, kind="stable")
    return stamps[order], np.array(poses, dtype=np.float64)[order]


def _odom_line(pose: str, time: str) -> str:
    return f"ODOM {pose} 0 0 0 {time} nohost {time}"


def _flaser_line(readings: str, laser: str, robot: str, time: str) -> str:
    return f"FLASER {readings} {laser} {robot} {time} nohost {time}"


def _pose_text(pose: np.ndarray) -> str:
    return " ".join(f"{value + 0.0:.6f}" for value in pose)


def _write_reference(path: Path, stamps: np.ndarray, poses: np.ndarray) -> Path:
    comment = "poses as another program corrected them, not ground truth"
    return _written(path, lambda part: write_tum(part, stamps, poses, comment))


def _write_log(path: Path, lines: Iterable[str]) -> Path:
    content = gzip.compress(("\n".join(lines) + "\n").encode(), mtime=0)
    return _written(path, lambda part: part.write_bytes(content))


def _written(path: Path, write: Callable[[Path], object]) -> Path:
    part = path.with_name(f"{path.name}.part")
    write(part)
    os.replace(part, path)
    return path
