"""Scores of an estimated occupancy map against a known one.

Scores are computed on the cells of the reference map. The two maps may differ in size, resolution and
origin, and the estimate may be moved by a pose first. Row 0 is the lowest y, column 0 the lowest x.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage

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
            raise ValueError(
                f"occupied has shape {self.occupied.shape} but free {self.free.shape}: "
                "give both on the same cells"
            )
        if bool((self.occupied & self.free).any()):
            count = int((self.occupied & self.free).sum())
            raise ValueError(f"{count} cells are both occupied and free: a cell is one or neither")
        if not (np.isfinite(self.resolution) and self.resolution > 0):
            raise ValueError(f"resolution is {self.resolution}: give a positive number of meters")
        if not np.isfinite(self.origin).all():
            raise ValueError(f"origin is {self.origin}: give finite meters")

    @classmethod
    def from_probability(
        cls,
        probability: Float[np.ndarray, "H W"],
        resolution: float,
        origin: Float[np.ndarray, "2"],
        occupied_threshold: float = 0.65,
        free_threshold: float = 0.25,
    ) -> "BinaryMap":
        """Threshold occupancy probabilities; the defaults are those of ROS map_server.

        Args:
            probability: `[H, W]` probability that a cell is occupied; NaN where unknown.
            resolution: side of a cell, meters.
            origin: `[2]` world position of the lower-left corner, meters.
            occupied_threshold: cells above it are occupied.
            free_threshold: cells below it are free.

        Raises:
            ValueError: if the thresholds are out of order.
        """
        if not 0 <= free_threshold <= occupied_threshold <= 1:
            raise ValueError(
                f"thresholds free {free_threshold} and occupied {occupied_threshold} are out of "
                "order: 0 <= free <= occupied <= 1"
            )
        return cls(
            occupied=probability > occupied_threshold,
            free=probability < free_threshold,
            resolution=resolution,
            origin=origin,
        )


@dataclass(frozen=True)
class MapScore:
    """Agreement of an estimated map with the known one.

    Attributes:
        precision: share of the estimate's occupied cells that lie within the tolerance of a
            reference one; 0 if the estimate has none.
        recall: share of the reference's occupied cells that lie within the tolerance of an
            estimated one.
        f1: harmonic mean of the two.
        iou: `f1 / (2 − f1)`; with tolerance 0 this is the intersection over union of the cells.
        free_iou: intersection over union of the free cells, without tolerance; None if neither map
            has a free cell.
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
    _check(reference, tolerance_m, pose, mask)
    counts = np.ones(reference.occupied.shape, bool) if mask is None else mask
    count_outside = mask is None
    radius = tolerance_m / reference.resolution

    cells = _occupied_cells(reference, estimate, pose)
    # Padding lets an estimated cell just outside still match a reference cell at the border.
    pad = int(radius + _SLACK) + 1
    height, width = reference.occupied.shape
    inside = ((cells >= -pad) & (cells < np.array([height + pad, width + pad]))).all(axis=1)
    occupied_estimate = np.zeros((height + 2 * pad, width + 2 * pad), bool)
    occupied_estimate[tuple((cells[inside] + pad).T)] = True
    occupied_reference = np.pad(reference.occupied, pad)
    counts_estimate = np.pad(counts, pad, constant_values=count_outside)
    counts_reference = np.pad(counts, pad)

    counted_estimate = occupied_estimate & counts_estimate
    counted_reference = occupied_reference & counts_reference
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


def _check(
    reference: BinaryMap,
    tolerance_m: float,
    pose: Float[np.ndarray, "3"],
    mask: Bool[np.ndarray, "_ _"] | None,
) -> None:
    if not (np.isfinite(tolerance_m) and tolerance_m >= 0):
        raise ValueError(f"tolerance_m is {tolerance_m}: give a number of meters that is >= 0")
    if not np.isfinite(pose).all():
        raise ValueError(f"pose_reference_estimate is {pose}: give finite meters and radians")
    if mask is not None and mask.shape != reference.occupied.shape:
        raise ValueError(
            f"mask has shape {mask.shape} but the reference map {reference.occupied.shape}: "
            "give the mask on the reference's cells"
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
    moved = points @ _rotation(pose[2]).T + pose[:2]
    cells = np.floor((moved - reference.origin) / reference.resolution).astype(np.int64)
    return np.unique(cells[:, ::-1], axis=0)


def _free_iou(
    reference: BinaryMap,
    estimate: BinaryMap,
    pose: Float[np.ndarray, "3"],
    counts: Bool[np.ndarray, "H W"],
    count_outside: bool,
) -> float | None:
    free_estimate = _lookup(estimate.free, estimate, reference, pose)
    shared = int((free_estimate & reference.free & counts).sum())
    union = int(((free_estimate | reference.free) & counts).sum())
    outside = 0.0
    if count_outside:
        centers = (np.argwhere(estimate.free)[:, ::-1] + 0.5) * estimate.resolution
        moved = (centers + estimate.origin) @ _rotation(pose[2]).T + pose[:2]
        extent = np.array(counts.shape)[::-1] * reference.resolution
        relative = moved - reference.origin
        beyond = ((relative < 0) | (relative >= extent)).any(axis=1).sum()
        outside = float(beyond) * (estimate.resolution / reference.resolution) ** 2
    return shared / (union + outside) if union + outside else None


def _lookup(
    values: Bool[np.ndarray, "A B"],
    source: BinaryMap,
    target: BinaryMap,
    pose_target_source: Float[np.ndarray, "3"],
) -> Bool[np.ndarray, "H W"]:
    """Return the source value under each center of a target cell; false outside the source."""
    height, width = target.occupied.shape
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    points = np.stack([x, y], axis=-1) * target.resolution + target.origin
    # Row vectors times R is Rᵀ applied to them: the inverse rotation.
    local = (points - pose_target_source[:2]) @ _rotation(pose_target_source[2])
    cells = np.floor((local - source.origin) / source.resolution).astype(np.int64)
    column, row = cells[..., 0], cells[..., 1]
    inside = (column >= 0) & (column < values.shape[1]) & (row >= 0) & (row < values.shape[0])
    return inside & values[np.where(inside, row, 0), np.where(inside, column, 0)]


def _dilate(cells: Bool[np.ndarray, "H W"], radius: float) -> Bool[np.ndarray, "H W"]:
    """Return the cells within `radius` cells (Euclidean, center to center) of a true cell."""
    # Without a true cell, SciPy's distances are undefined.
    near = ndimage.distance_transform_edt(~cells) <= radius + _SLACK
    return near & cells.any()


def _rotation(theta: float | np.floating) -> Float[np.ndarray, "2 2"]:
    cos, sin = np.cos(theta), np.sin(theta)
    return np.array([[cos, -sin], [sin, cos]])
