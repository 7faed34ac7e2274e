"""Whether a loop is closed: in the path and in the map."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int

from jaxslam.core import se2
from jaxslam.metrics.map import BinaryMap


@dataclass(frozen=True)
class LoopClosure:
    """What was found where the robot came back.

    Attributes:
        closed: whether path and map agree there, by the thresholds given.
        revisits: pairs of poses that truly lie in one place, the second after a loop.
        position_error: median over them of how far the one is off, seen from the other, meters.
        heading_error: and how much it is turned, radians.
        walls_once: share of the walls mapped there that lie where one wall truly is.
    """

    closed: bool
    revisits: int
    position_error: float
    heading_error: float
    walls_once: float


def loop_closed(
    truth: Float64[np.ndarray, "_ 3"],
    estimate: Float64[np.ndarray, "_ 3"],
    reference: BinaryMap,
    mapped: BinaryMap,
    *,
    near: float = 1.0,
    loop: float = 20.0,
    last: float = 5.0,
    reach: float = 3.0,
    max_position_error: float = 0.3,
    max_heading_error: float = np.deg2rad(5.0),
    wall_tolerance: float = 0.2,
    min_walls_once: float = 0.8,
) -> LoopClosure:
    """Look at the places that the robot came back to at the end of its path.

    In the path: the pose of the second visit, seen from that of the first, is compared with the truth. What
    the map drifted by in between does not matter, as it does not to a robot; a loop that was left open does.
    In the map: it is laid onto the truth by the second visit, and its walls within reach must lie on true
    walls. Of a wall that was mapped twice the older one does not.

    Args:
        truth: `[T, 3]` true base poses (m, m, rad).
        estimate: `[T, 3]` the final trajectory at the same stamps.
        reference: the true map, in the frame of the true poses.
        mapped: the final map, in the frame of the estimate.
        near: poses nearer than this are one place, meters.
        loop: and a path at least so long between them is a loop, meters.
        last: of the second visits those within so much path of the last one count, meters: by then the
            filter has had time to notice.
        reach: how far round them the map is looked at, meters.
        max_position_error: meters, in the median.
        max_heading_error: radians, in the median.
        wall_tolerance: a wall lies on a true one within this, meters.
        min_walls_once: share of the walls.

    Raises:
        ValueError: shapes differ, or the robot never came back: then there is no loop to close.
    """
    if truth.shape != estimate.shape:
        raise ValueError(
            f"{len(truth)} true poses for {len(estimate)} estimated ones: give them at the same stamps"
        )
    first, second = _revisits(truth, near, loop, last)
    if not len(first):
        raise ValueError(
            f"the robot never came within {near:g} m of where it had been {loop:g} m before: there is no loop"
        )
    true = se2.relative(truth[first], truth[second])
    off = se2.relative(true, se2.relative(estimate[first], estimate[second]))
    position = float(np.median(np.hypot(off[:, 0], off[:, 1])))
    heading = float(np.median(np.abs(off[:, 2])))
    once = _walls_once(truth[second], estimate[second], reference, mapped, reach, wall_tolerance)
    closed = position <= max_position_error and heading <= max_heading_error and once >= min_walls_once
    return LoopClosure(bool(closed), len(first), position, heading, once)


def _revisits(
    truth: Float64[np.ndarray, "T 3"], near: float, loop: float, last: float
) -> tuple[Int[np.ndarray, "R"], Int[np.ndarray, "R"]]:
    """Return pairs of steps at one place: each second visit near the last, with its nearest first visit."""
    path = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(truth[:, :2], axis=0).T))])
    first, second = [], []
    for step in range(len(truth)):
        before = np.flatnonzero(path <= path[step] - loop)
        if not len(before):
            continue
        distance = np.hypot(*(truth[before, :2] - truth[step, :2]).T)
        nearest = int(np.argmin(distance))
        if distance[nearest] <= near:
            first.append(int(before[nearest]))
            second.append(step)
    if not second:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    kept = path[second] >= path[second[-1]] - last
    return np.asarray(first)[kept], np.asarray(second)[kept]


def _walls_once(
    truth: Float64[np.ndarray, "R 3"],
    estimate: Float64[np.ndarray, "R 3"],
    reference: BinaryMap,
    mapped: BinaryMap,
    reach: float,
    tolerance: float,
) -> float:
    """Return the share of cells near the poses that lie on a true wall, placed by the nearest pose."""
    cells = _centers(mapped)
    distance = np.stack([np.hypot(*(cells - pose[:2]).T) for pose in estimate])
    within = distance.min(axis=0) <= reach
    if not within.any():
        return 0.0
    pose, cells = np.argmin(distance, axis=0)[within], cells[within]
    seen = se2.relative(estimate[pose], np.pad(cells, ((0, 0), (0, 1))))
    places = se2.compose(truth[pose], seen)[:, :2]
    walls = _centers(reference)
    # Walls farther off than the tolerance do not count.
    low, high = places.min(axis=0) - tolerance, places.max(axis=0) + tolerance
    walls = walls[np.all((walls >= low) & (walls <= high), axis=1)]
    on_a_wall = [bool((np.hypot(*(walls - place).T) <= tolerance).any()) for place in places]
    return float(np.mean(on_a_wall))


def _centers(known: BinaryMap) -> Float64[np.ndarray, "C 2"]:
    """Return the centers of the occupied cells, meters."""
    rows, columns = np.nonzero(known.occupied)
    return (np.stack([columns, rows], axis=1) + 0.5) * known.resolution + np.asarray(known.origin, np.float64)
