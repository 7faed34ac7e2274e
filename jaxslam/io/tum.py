"""Trajectories in the TUM format: `t tx ty tz qx qy qz qw`, one pose a line, `#` for comments."""

from pathlib import Path

import numpy as np
from jaxtyping import Float64

from jaxslam.core.trajectory import Trajectory, yaw_from_quaternion
from jaxslam.io.files import one_line_errors
from jaxslam.io.log import LogError


def write_tum(
    path: str | Path,
    stamps: Float64[np.ndarray, "M"],
    poses: Float64[np.ndarray, "M 3"],
    comment: str | None = None,
) -> None:
    """Write a planar trajectory.

    Args:
        path: file to write; an existing one is replaced.
        stamps: `[M]` seconds, written with microseconds.
        poses: `[M, 3]` x m, y m, theta rad; written with 6 decimals, the quaternion with 9.
        comment: text for the head of the file; each line becomes a comment.

    Raises:
        ValueError: a stamp or pose is not finite.
    """
    bad = np.flatnonzero(~(np.isfinite(stamps) & np.isfinite(poses).all(axis=1)))
    if bad.size:
        row = int(bad[0])
        raise ValueError(
            f"{path}: pose {row} of the trajectory is not finite ({poses[row].tolist()} at "
            f"{stamps[row]!r} s): leave out the poses that are not known"
        )
    lines = [f"# {line}" for line in (comment or "").splitlines()]
    lines.append("# timestamp tx ty tz qx qy qz qw")
    half = poses[:, 2] / 2
    for stamp, (x, y, _), qz, qw in zip(stamps, poses, np.sin(half), np.cos(half), strict=True):
        lines.append(f"{stamp:.6f} {x:.6f} {y:.6f} 0 0 0 {qz:.9f} {qw:.9f}")
    Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")


def read_tum(path: str | Path) -> Trajectory:
    """Read a trajectory; 3-D poses are projected to x, y and yaw.

    Args:
        path: file to read. Fields are separated by blanks or commas.

    Returns:
        Stamps `[M]` in seconds, in the order of the file, and poses `[M, 3]`.

    Raises:
        LogError: the file is missing or empty, or a line is not a pose (the message has its number).
    """
    path = Path(path)
    table, line_numbers = read_number_rows(path, 8, "timestamp tx ty tz qx qy qz qw")
    quaternions = table[:, 4:8]
    lengths = np.linalg.norm(quaternions, axis=1)
    if not table[:, 4:7].any() and np.any(np.abs(lengths - 1) > 0.01) and lengths.any():
        raise LogError(f"{path}: these are relations, not poses in TUM format: give them with --relations")
    null = np.flatnonzero(lengths < 1e-6)
    if null.size:
        raise LogError(
            f"{path}:{line_numbers[null[0]]}: the quaternion is zero: write a unit quaternion "
            "(0 0 0 1 for no rotation)"
        )
    poses = np.stack([table[:, 1], table[:, 2], yaw_from_quaternion(quaternions)], axis=1)
    return Trajectory(table[:, 0], poses)


def read_number_rows(path: Path, columns: int, names: str) -> tuple[Float64[np.ndarray, "M C"], list[int]]:
    """Read a table of finite numbers from a text file; also return the line number of each row.

    Args:
        path: text file; blank lines and lines that start with `#` are skipped.
        columns: number of columns.
        names: names of the columns, for the error message.

    Raises:
        LogError: the file cannot be read, has no row, or a line is not `columns` finite numbers.
    """
    try:
        with one_line_errors(path):
            text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise LogError(f"{path}: not a text file: expected lines '{names}'") from None
    rows, line_numbers = [], []
    for number, line in enumerate(text.splitlines(), start=1):
        fields = line.replace(",", " ").split()
        if not fields or fields[0].startswith("#"):
            continue
        try:
            row = [float(field) for field in fields]
        except ValueError:
            raise LogError(f"{path}:{number}: not a number: expected '{names}'") from None
        if len(row) != columns:
            raise LogError(f"{path}:{number}: {len(row)} fields, not {columns}: expected '{names}'")
        if not np.isfinite(row).all():
            raise LogError(f"{path}:{number}: a value is not finite: remove this line")
        rows.append(row)
        line_numbers.append(number)
    if not rows:
        raise LogError(f"{path}: has no data: expected lines '{names}'")
    return np.array(rows), line_numbers
