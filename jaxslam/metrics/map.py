"""Scores of an estimated occupancy map against a known one.

Scores are computed on the cells of the reference map. The two maps may differ in size, resolution and
origin, and the estimate may be moved by a pose first. Row 0 is the lowest y, column 0 the lowest x.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Array, Bool, Float, Float64, Int, Int8
from scipy import ndimage

from jaxslam.core import se2
from jaxslam.core.types import Scalar
from jaxslam.io.map_server import FREE_THRESHOLD, OCCUPIED_THRESHOLD
from jaxslam.pipeline.run import occupancy_probability

# A tolerance of three 5 cm cells is 2.9999999 cells when a resolution came through float32.
_SLACK = 1e-6


@dataclass(frozen=True)
class BinaryMap:
    """A map with two masks: occupied cells and free cells. All other cells are unknown.

    Attributes:
        occupied: `[H, W]` true where there is an obstacle.
        free: `[H, W]` true where there is certainly no obstacle.
        resolution: side of a cell, meters.
        origin: `[2]` world position of the lower-left corner of cell (0, 0), meters.
    """

    occupied: Bool[np.ndarray, "_ _"]
    free: Bool[np.ndarray, "_ _"]
    resolution: float
    origin: Float[np.ndarray, "2"]

    def __post_init__(self) -> None:
        if self.occupied.shape != self.free.shape:
            shapes = f"occupied has shape {self.occupied.shape} but free {self.free.shape}"
            raise ValueError(f"{shapes}: give both on the same cells")
        if count := np.count_nonzero(self.occupied & self.free):
            raise ValueError(f"{count} cells are both occupied and free: give each cell at most one")
        if not (np.isfinite(self.resolution) and self.resolution > 0):
            raise ValueError(f"resolution is {self.resolution}: give a positive number of meters")
        if not np.isfinite(self.origin).all():
            raise ValueError(f"origin is {self.origin}: give finite meters")

    @classmethod
    def from_probability(
        cls, probability: Float[np.ndarray, "H W"], resolution: float, origin: Float[np.ndarray, "2"]
    ) -> "BinaryMap":
        """Apply the thresholds of ROS map_server to probabilities of an obstacle `[H, W]`, NaN if unknown."""
        return cls(probability > OCCUPIED_THRESHOLD, probability < FREE_THRESHOLD, resolution, origin)

    @classmethod
    def from_log_odds(
        cls, log_odds: Int8[np.ndarray, "H W"], resolution: Scalar, origin: Float[np.ndarray | Array, "2"]
    ) -> "BinaryMap":
        """Return the occupied and the free cells of a filter's map, given in fixed point."""
        probability = occupancy_probability(log_odds)
        return cls.from_probability(probability, float(resolution), np.asarray(origin, np.float64))

    def centers(self, chosen: Bool[np.ndarray, "_ _"]) -> Float64[np.ndarray, "C 2"]:
        """Return the world positions of the centers of the chosen cells, meters, row by row."""
        return (np.argwhere(chosen)[:, ::-1] + 0.5) * self.resolution + self.origin


@dataclass(frozen=True)
class MapScore:
    """Agreement of an estimated map with the known one.

    Attributes:
        precision: share of the estimate's occupied cells within the tolerance of a reference one; 0 if none.
        recall: share of the reference's occupied cells within the tolerance of an estimated one.
        f1: harmonic mean of the two.
        iou: `f1 / (2 − f1)`; with tolerance 0 this is the intersection over union of the cells.
        free_iou: intersection over union of the free cells, without tolerance; None if there are none.
        n_estimate: number of occupied cells of the estimate inside the mask, in reference cells.
        n_reference: number of occupied cells of the reference inside the mask.
    """

    precision: float
    recall: float
    f1: float
    iou: float
    free_iou: float | None
    n_estimate: int
    n_reference: int


def map_score(
    reference: BinaryMap,
    estimate: BinaryMap,
    *,
    tolerance_m: float = 0.0,
    pose_reference_estimate: Float[np.ndarray, "3"] | None = None,
    mask: Bool[np.ndarray, "_ _"] | None = None,
) -> MapScore:
    """Return precision, recall, F1 and IoU of occupied cells, and IoU of free cells.

    The centers of the estimate's occupied cells are transformed to the reference, so that walls of one cell
    survive a rotation. Free space is looked up in the opposite direction, so that it gets no holes.

    Args:
        reference: the known map.
        estimate: the map to score.
        tolerance_m: an occupied cell is matched if the other map has one whose center is at most
            this far, meters. 0 requires the same cell.
        pose_reference_estimate: `[3]` pose of the estimate's world frame in the reference's (m, m,
            rad), e.g. from `align_se2` of the trajectories; None for the identity.
        mask: `[H, W]` reference cells to score. None scores every cell, and occupied cells of the estimate
            outside the reference map count as wrong.

    Raises:
        ValueError: if the mask has another shape, the tolerance is negative or not finite, the pose
            is not finite, or no occupied reference cell counts.

    Example:
        Reference wall of 3 cells, estimate has 2 of them and 1 elsewhere: precision 2/3, recall
        2/3, f1 2/3, iou 2/4.
    """
    pose = np.zeros(3) if pose_reference_estimate is None else pose_reference_estimate
    if not (np.isfinite(tolerance_m) and tolerance_m >= 0):
        raise ValueError(f"tolerance_m is {tolerance_m}: give a number of meters that is >= 0")
    if not np.isfinite(pose).all():
        raise ValueError(f"pose_reference_estimate is {pose}: give finite meters and radians")
    if mask is not None and mask.shape != reference.occupied.shape:
        shapes = f"mask has shape {mask.shape} but the reference map {reference.occupied.shape}"
        raise ValueError(f"{shapes}: give the mask on the reference's cells")
    count_outside = mask is None
    counts = np.ones_like(reference.occupied) if mask is None else mask
    radius = tolerance_m / reference.resolution

    cells = _occupied_cells(reference, estimate, pose)
    # Padding lets an estimated cell just outside still match a reference cell at the border.
    pad = int(radius + _SLACK) + 1
    height, width = reference.occupied.shape
    inside = ((cells >= -pad) & (cells < np.array([height + pad, width + pad]))).all(axis=1)
    occupied_estimate = np.zeros((height + 2 * pad, width + 2 * pad), bool)
    occupied_estimate[tuple((cells[inside] + pad).T)] = True
    occupied_reference = np.pad(reference.occupied, pad)

    counted_estimate = occupied_estimate & np.pad(counts, pad, constant_values=count_outside)
    counted_reference = np.pad(reference.occupied & counts, pad)
    n_estimate = int(counted_estimate.sum()) + int((~inside).sum()) * count_outside
    n_reference = int(counted_reference.sum())
    if n_reference == 0:
        raise ValueError("no occupied cell of the reference map is scored: check the map and the mask")
    hits_estimate = int((counted_estimate & _dilate(occupied_reference, radius)).sum())
    hits_reference = int((counted_reference & _dilate(occupied_estimate, radius)).sum())

    precision = hits_estimate / n_estimate if n_estimate else 0.0
    recall = hits_reference / n_reference
    f1 = 2 * precision * recall / (precision + recall) if precision + recall else 0.0
    return MapScore(
        precision=precision,
        recall=recall,
        f1=f1,
        iou=f1 / (2 - f1),
        free_iou=_free_iou(reference, estimate, pose, counts, count_outside),
        n_estimate=n_estimate,
        n_reference=n_reference,
    )


def _occupied_cells(
    reference: BinaryMap, estimate: BinaryMap, pose: Float[np.ndarray, "3"]
) -> Int[np.ndarray, "K 2"]:
    """Return the distinct (row, column) reference cells hit by the estimate's occupied cells."""
    # A coarser estimate is split so that one of its cells covers all the reference cells under it.
    splits = max(1, int(np.ceil(estimate.resolution / reference.resolution - _SLACK)))
    fraction = (np.arange(splits) + 0.5) / splits
    offsets = np.stack(np.meshgrid(fraction, fraction), axis=-1).reshape(-1, 2)
    column_row = np.argwhere(estimate.occupied)[:, ::-1]
    points = (column_row[:, None] + offsets).reshape(-1, 2) * estimate.resolution + estimate.origin
    moved = se2.apply(pose, points)
    cells = np.floor((moved - reference.origin) / reference.resolution).astype(np.int64)
    return np.unique(cells[:, ::-1], axis=0)


def _free_iou(
    reference: BinaryMap,
    estimate: BinaryMap,
    pose: Float[np.ndarray, "3"],
    counts: Bool[np.ndarray, "H W"],
    count_outside: bool,
) -> float | None:
    free_estimate = _free_on_cells_of(reference, estimate, pose)
    shared = int((free_estimate & reference.free & counts).sum())
    union = int(((free_estimate | reference.free) & counts).sum())
    outside = 0.0
    if count_outside:
        extent = np.array(counts.shape)[::-1] * reference.resolution
        relative = se2.apply(pose, estimate.centers(estimate.free)) - reference.origin
        beyond = ((relative < 0) | (relative >= extent)).any(axis=1).sum()
        outside = float(beyond) * (estimate.resolution / reference.resolution) ** 2
    return shared / (union + outside) if union + outside else None


def _free_on_cells_of(
    reference: BinaryMap, estimate: BinaryMap, pose: Float[np.ndarray, "3"]
) -> Bool[np.ndarray, "H W"]:
    """Return which reference cells have their center on a free cell of the estimate."""
    points = reference.centers(np.ones_like(reference.free))
    local = se2.rotate(-pose[2], points - pose[:2])
    cells = np.floor((local - estimate.origin) / estimate.resolution).astype(np.int64)[:, ::-1]
    inside = ((cells >= 0) & (cells < estimate.free.shape)).all(axis=1)
    free = np.zeros(len(cells), bool)
    free[inside] = estimate.free[tuple(cells[inside].T)]
    return free.reshape(reference.free.shape)


def _dilate(cells: Bool[np.ndarray, "H W"], radius: float) -> Bool[np.ndarray, "H W"]:
    """Return the cells within `radius` cells (Euclidean, center to center) of a true cell."""
    # Without a true cell, SciPy's distances are undefined.
    return cells.any() & (ndimage.distance_transform_edt(~cells) <= radius + _SLACK)
