"""Readings of a wall at known distances, from tables and bags."""

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float64

from jaxslam.io import read_log

_COLUMNS = ("true_m", "measured_m")
_LONGEST = 500.0
"""Meters. No 2D lidar has a longer range, so larger numbers are assumed to be millimeters."""
_REPEATED, _MORE = 5, 2
"""The columns are assumed to be exchanged if each reading occurs more than 5 times on average and there are
more than twice as many distances as readings."""


@dataclass(frozen=True)
class Readings:
    """Readings of a lidar and the true distances.

    Attributes:
        true: `[M]` distances of the wall, meters.
        measured: `[M]` readings, meters.
        num_lost: number of readings without a return, which are excluded.
    """

    true: Float64[np.ndarray, "M"]
    measured: Float64[np.ndarray, "M"]
    num_lost: int = 0

    def __post_init__(self):
        if len(self.true) != len(self.measured):
            raise ValueError(
                f"{len(self.true)} distances for {len(self.measured)} readings: give one for each"
            )

    @property
    def distances(self) -> Float64[np.ndarray, "D"]:
        """Return the distinct true distances, ascending, meters."""
        return np.unique(self.true)

    def where(self, chosen: Bool[np.ndarray, "M"]) -> "Readings":
        """Return the readings selected by a mask."""
        return Readings(self.true[chosen], self.measured[chosen])

    def means(self) -> "Readings":
        """Return one reading for each distance, the mean of its readings."""
        distances, at = np.unique(self.true, return_inverse=True)
        return Readings(distances, np.bincount(at, self.measured) / np.bincount(at))

    @classmethod
    def joined(cls, parts: Sequence["Readings"]) -> "Readings":
        """Return the readings of several recordings in one."""
        return cls(
            np.concatenate([part.true for part in parts]),
            np.concatenate([part.measured for part in parts]),
            sum(part.num_lost for part in parts),
        )


def read_readings(source: str, *, bearing: float = 0.0) -> Readings:
    """Read a table or a recording.

    Args:
        source: path of a CSV file with the columns `true_m` and `measured_m`, meters; or `PATH:DISTANCE`, a
            log of a robot that stands before a wall, and the distance of the wall, meters.
        bearing: bearing of the beam that faces the wall, in the lidar's frame, radians.

    Raises:
        ValueError: the source has no usable readings.
        OSError: the source cannot be read.
    """
    path, colon, distance = source.rpartition(":")
    if colon and _number(distance) is not None:
        return read_wall_log(Path(path), float(distance), bearing=bearing)
    if Path(source).suffix.lower() != ".csv":
        raise ValueError(
            f"{source}: give a table as FILE.csv, or a log with the distance of the wall in meters, "
            f"as {source}:1.5"
        )
    return read_readings_csv(Path(source))


def read_wall_log(path: Path, distance: float, *, bearing: float = 0.0) -> Readings:
    """Read the one beam of a log that faces a wall; see `read_readings`."""
    if not (math.isfinite(distance) and 0.0 < distance < _LONGEST):
        raise ValueError(
            f"{path}: distance of the wall is {distance:g} m: give more than 0 and less than {_LONGEST:g}"
        )
    if not math.isfinite(bearing):
        raise ValueError(f"{path}: bearing is {bearing:g}: give radians")
    scans = read_log(path).scans
    if scans is None or not len(scans.ranges):
        raise ValueError(f"{path}: no scan in it")
    beams = np.arange(scans.ranges.shape[1])
    angles = scans.angle_min[:, None] + scans.angle_increment[:, None] * beams
    off = np.abs(np.angle(np.exp(1j * (angles - bearing))))
    beam = np.argmin(off, axis=1)[:, None]
    nearest = np.take_along_axis(off, beam, axis=1)[:, 0]
    if np.any(nearest > np.abs(scans.angle_increment)):
        raise ValueError(
            f"{path}: no beam at a bearing of {bearing:g} rad: the nearest is {nearest.max():.3g} rad off"
        )
    ranges = np.take_along_axis(scans.ranges, beam, axis=1)[:, 0].astype(np.float64)
    return _with_returns(path, np.full(len(ranges), distance), ranges)


def read_readings_csv(path: Path) -> Readings:
    """Read a table; see `read_readings`."""
    with path.open(newline="", encoding="utf-8-sig", errors="replace") as stream:
        try:
            numbered = enumerate(csv.reader(stream), 1)
            rows = [(line, row) for line, row in numbered if any(map(str.strip, row))]
        except csv.Error as error:
            raise ValueError(f"{path}: not a CSV table: {error}") from None
    if not rows:
        raise ValueError(f"{path}: empty; give the columns {' and '.join(_COLUMNS)}")
    header = [name.strip().lower() for name in rows.pop(0)[1]]
    missing = [name for name in _COLUMNS if name not in header]
    if missing:
        raise ValueError(
            f"{path}: no column {' nor '.join(missing)} in its first line ({', '.join(header)}): "
            f"give the columns {' and '.join(_COLUMNS)}, meters"
        )
    twice = [name for name in _COLUMNS if header.count(name) > 1]
    if twice:
        raise ValueError(f"{path}: two columns {twice[0]} in its first line: remove one")
    if not rows:
        raise ValueError(f"{path}: no readings below its first line")
    places = [header.index(name) for name in _COLUMNS]
    true, measured = np.asarray([_row(path, line, row, places) for line, row in rows]).T
    _check_distances(path, true, measured, [line for line, _ in rows])
    return _with_returns(path, true, measured)


def _row(path: Path, line: int, row: list[str], places: list[int]) -> list[float]:
    """Return the true distance and the reading of a line; the reading is NaN if the beam did not return."""
    numbers = []
    for name, place, missing in zip(_COLUMNS, places, ("", "nan"), strict=True):
        text = row[place].strip() if place < len(row) else ""
        number = _number(text or missing)
        if number is None:
            raise ValueError(f"{path}: line {line}: {name} is {text!r}, which is not a number")
        numbers.append(number)
    return numbers


def _check_distances(
    path: Path, true: Float64[np.ndarray, "M"], measured: Float64[np.ndarray, "M"], lines: list[int]
) -> None:
    """Raise `ValueError` for invalid distances and for exchanged columns."""
    read = measured[np.isfinite(measured) & (measured > 0)]
    num_true, num_read = len(np.unique(true)), len(np.unique(read))
    # A wall is recorded at few distances, but yields many different readings.
    if len(read) > _REPEATED * num_read and num_true > _MORE * num_read:
        raise ValueError(
            f"{path}: true_m has {num_true} different values and measured_m {num_read}, but a wall has few "
            "distances and many readings: are the columns exchanged?"
        )
    bad = np.flatnonzero(~np.isfinite(true) | (true <= 0))
    if len(bad):
        raise ValueError(
            f"{path}: line {lines[bad[0]]}: true_m is {true[bad[0]]:g}: give meters, more than 0 (only a "
            "reading may be missing: are the columns exchanged?)"
        )
    far = np.flatnonzero(true > _LONGEST)
    if len(far):
        raise ValueError(
            f"{path}: line {lines[far[0]]}: true_m is {true[far[0]]:g}: are these millimeters? Give meters"
        )


def _with_returns(path: Path, true: Float64[np.ndarray, "M"], measured: Float64[np.ndarray, "M"]) -> Readings:
    returned = np.isfinite(measured) & (measured > 0)
    if not returned.any():
        raise ValueError(f"{path}: none of its {len(measured)} readings is a distance")
    if float(np.median(measured[returned])) > _LONGEST:
        raise ValueError(f"{path}: readings of {np.median(measured[returned]):g} m: are these millimeters?")
    return Readings(true[returned], measured[returned], int(np.count_nonzero(~returned)))


def _number(text: str) -> float | None:
    # Python reads `2_0` as 20, but in a table it is more likely an error.
    if "_" in text:
        return None
    try:
        return float(text)
    except ValueError:
        return None
