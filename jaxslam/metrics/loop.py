"""Loop closure: whether a loop is closed in the path and in the map."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int

from jaxslam.core import se2
from jaxslam.metrics.map import BinaryMap


@dataclass(frozen=True)
class LoopClosure:
    """Agreement of path and map where the robot came back.

    Attributes:
        closed: whether path and map agree within the given thresholds.
        revisits: number of pairs of true poses at one place, the second after a loop.
        position_error: median position error of the second pose relative to the first, meters.
        heading_error: median heading error of the second pose relative to the first, radians.
        walls_once: share of the walls mapped there that lie on a true wall.
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
    """Check the places to which the robot came back at the end of its path.

    In the path, the pose of the second visit relative to the first is compared with the truth; drift between
    the visits does not count. The map is aligned with the truth at the second visit, and its walls within
    reach must lie on true walls. If a wall is mapped twice, the older copy does not lie on a true wall.

    Args:
        truth: `[T, 3]` true base poses (m, m, rad).
        estimate: `[T, 3]` the final trajectory at the same stamps.
        reference: the true map, in the frame of the true poses.
        mapped: the final map, in the frame of the estimate.
        near: poses nearer than this are at one place, meters.
        loop: shortest path between two visits that counts as a loop, meters.
        last: only second visits within this path length of the last one count, meters: by then the filter
            has had time to close the loop.
        reach: radius around the second visits in which walls are checked, meters.
        max_position_error: largest median position error, meters.
        max_heading_error: largest median heading error, radians.
        wall_tolerance: largest distance of a mapped wall from a true one, meters.
        min_walls_once: smallest share of walls on true walls.

    Raises:
        ValueError: shapes differ, or the robot never came back, so there is no loop to close.
    """
    if truth.shape != estimate.shape:
        raise ValueError(
            f"{len(truth)} true poses for {len(estimate)} estimated ones: give them at the same stamps"
        )
    first, second = _revisits(truth, near, loop, last)
    if not len(first):
        raise ValueError(
            f"no place is revisited within {near:g} m after {loop:g} m of path: there is no loop"
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
    pairs = []
    for step in range(len(truth)):
        before = np.flatnonzero(path <= path[step] - loop)
        distance = np.hypot(*(truth[before, :2] - truth[step, :2]).T)
        if len(before) and distance.min() <= near:
            pairs.append((before[np.argmin(distance)], step))
    first, second = np.array(pairs, np.int64).reshape(-1, 2).T
    kept = path[second] >= path[second[-1:]] - last
    return first[kept], second[kept]


def _walls_once(
    truth: Float64[np.ndarray, "R 3"],
    estimate: Float64[np.ndarray, "R 3"],
    reference: BinaryMap,
    mapped: BinaryMap,
    reach: float,
    tolerance: float,
) -> float:
    """Return the share of cells near the poses that lie on a true wall, placed by the nearest pose."""
    cells = mapped.centers(mapped.occupied)
    distance = np.stack([np.hypot(*(cells - pose[:2]).T) for pose in estimate])
    within = distance.min(axis=0) <= reach
    if not within.any():
        return 0.0
    pose, cells = np.argmin(distance, axis=0)[within], cells[within]
    seen = se2.relative(estimate[pose], np.pad(cells, ((0, 0), (0, 1))))
    places = se2.compose(truth[pose], seen)[:, :2]
    walls = reference.centers(reference.occupied)
    # Skip true walls farther away than the tolerance.
    low, high = places.min(axis=0) - tolerance, places.max(axis=0) + tolerance
    walls = walls[np.all((walls >= low) & (walls <= high), axis=1)]
    on_a_wall = [bool((np.hypot(*(walls - place).T) <= tolerance).any()) for place in places]
    return float(np.mean(on_a_wall))
