"""Rasterization of a world to the cells of a grid: the ideal map (host)."""

import numpy as np
from jaxtyping import Array, Bool, Float, Float64, Int
from scipy import ndimage

from jaxslam.grid.spec import GridSpec
from jaxslam.metrics.map import BinaryMap
from jaxslam.sim.worlds.world import World


def rasterize(world: World, spec: GridSpec) -> Bool[np.ndarray, "H W"]:
    """Mark every cell `[H, W]` of the grid that a segment crosses.

    A cell spans [lower, upper) on both axes, so a wall exactly on the line between two cells belongs to the
    upper one. A cell that is only touched at a corner stays unmarked.
    """
    segments = np.asarray(world.segments, np.float64).reshape(-1, 2, 2)
    ends = (segments - np.asarray(spec.origin, np.float64)) / float(spec.resolution)
    # float32 coordinates that should lie on grid lines are about 1e-5 cells off.
    ends = np.where(np.abs(ends - np.round(ends)) < 1e-4, np.round(ends), ends)
    occupied = np.zeros((spec.height, spec.width), bool)
    for start, end in ends:
        columns, rows = _cells_crossed(start, end).T
        inside = (columns >= 0) & (columns < spec.width) & (rows >= 0) & (rows < spec.height)
        occupied[rows[inside], columns[inside]] = True
    return occupied


def reachable(
    occupied: Bool[np.ndarray, "H W"], spec: GridSpec, start: Float[np.ndarray, "2"] | Float[Array, "2"]
) -> Bool[np.ndarray, "H W"]:
    """Return the free cells `[H, W]` connected over their sides to `start` (meters, world frame).

    Raises:
        ValueError: if `start` lies outside the grid or on an occupied cell.
    """
    cell = (np.asarray(start, np.float64) - np.asarray(spec.origin)) / float(spec.resolution)
    column, row = (int(value) for value in np.floor(cell))
    height, width = occupied.shape
    where = list(map(float, start))
    if not (0 <= row < height and 0 <= column < width):
        raise ValueError(f"start {where} lies outside the grid: give a start on it")
    if occupied[row, column]:
        raise ValueError(f"start {where} lies on an occupied cell: give a start in free space")
    regions, _ = ndimage.label(~occupied)
    return regions == regions[row, column]


def observable(
    world: World, spec: GridSpec, start: Float[np.ndarray, "2"] | Float[Array, "2"]
) -> tuple[Bool[np.ndarray, "H W"], Bool[np.ndarray, "H W"]]:
    """Return the occupied and free cells `[H, W]` that a robot starting at `start` (meters) can observe.

    Free cells are reachable from `start`; occupied cells touch a free cell by a side or a corner. Cells
    inside machines and beyond the walls are neither. The grid should cover the world; otherwise the outside
    is reachable through the missing wall.

    Raises:
        ValueError: if `start` lies outside the grid or on an occupied cell.
    """
    occupied = rasterize(world, spec)
    free = reachable(occupied, spec, start)
    return occupied & ndimage.binary_dilation(free, np.ones((3, 3))), free


def true_map(world: World, spec: GridSpec, start: Float[np.ndarray, "2"] | Float[Array, "2"]) -> BinaryMap:
    """Return the `observable` cells as a map, to score an estimate on the same cells."""
    occupied, free = observable(world, spec, start)
    return BinaryMap(occupied, free, float(spec.resolution), np.asarray(spec.origin, np.float64))


def _cells_crossed(start: Float64[np.ndarray, "2"], end: Float64[np.ndarray, "2"]) -> Int[np.ndarray, "_ 2"]:
    """Return (column, row) of each cell crossed by the line between two points in cell units."""
    fractions = [np.array([0.0, 1.0])]
    for first, last in zip(start, end, strict=True):
        lines = np.arange(np.ceil(min(first, last)), np.floor(max(first, last)) + 1)
        if first != last:
            fractions.append((lines - first) / (last - first))
    crossings = np.unique(np.clip(np.concatenate(fractions), 0.0, 1.0))
    middles = (crossings[:-1] + crossings[1:]) / 2
    # Pieces of rounding size come from crossing two grid lines at a corner.
    middles = middles[np.diff(crossings) > 1e-9]
    return np.floor(start + middles[:, None] * (end - start)).astype(int)
