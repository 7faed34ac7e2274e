"""Convert occupancy maps to small images: one level per cell, pooled without losing walls.

A map with cells of 5 cm often has more cells than a picture has pixels. Averaging would fade walls of one
cell, and skipping cells would drop them. Each pixel therefore shows the *most occupied* cell that it covers.
"""

import numpy as np
from jaxtyping import Array, Shaped, UInt8

from jaxslam.pipeline.run import occupancy_probability

UNKNOWN_GRAY = 208
"""Gray value of unknown cells and of known cells with probability 0.5; free cells are 255."""


def map_levels(occupancy: Shaped[np.ndarray | Array, "*shape"]) -> UInt8[np.ndarray, "H W"]:
    """Convert a map to levels: 0 where unknown, else 1 (certainly free) to 255 (certainly occupied).

    Args:
        occupancy: `[H, W]`, row 0 at the lowest y. Floats are probabilities in [0, 1], unknown where NaN or
            exactly 0.5. int8 values are the filter's fixed-point log-odds, unknown where 0. uint8 values are
            levels and are returned unchanged.

    Raises:
        ValueError: the array is not a map of one of these kinds.
    """
    cells = np.asarray(occupancy)
    if cells.ndim != 2 or 0 in cells.shape:
        raise ValueError(f"the map has shape {cells.shape}: give [H, W] with at least one cell")
    if cells.dtype == np.uint8:
        return cells
    if cells.dtype == np.int8:
        # Look the values up by their bits: a map has many cells, but only 256 values.
        every = np.arange(256, dtype=np.uint8).view(np.int8)
        table = map_levels(occupancy_probability(every[None]))[0]
        return table[cells.view(np.uint8)]
    if not np.issubdtype(cells.dtype, np.floating):
        raise ValueError(
            f"the map has type {cells.dtype}: give probabilities (float), log-odds (int8) or levels (uint8)"
        )
    known = np.isfinite(cells) & (cells != 0.5)
    probability = np.where(known, cells, 0.5)
    if probability.min() < 0 or probability.max() > 1:
        raise ValueError(
            f"the map's values run from {probability.min():g} to {probability.max():g}: give "
            "probabilities in [0, 1], or log-odds as int8"
        )
    return np.where(known, 1 + np.round(254 * probability), 0).astype(np.uint8)


def shrink(levels: UInt8[np.ndarray, "_ _"], height: int, width: int) -> UInt8[np.ndarray, "_ _"]:
    """Pool levels to at most `[height, width]`; each pixel shows the most occupied cell that it covers.

    A pixel is unknown only if all its cells are unknown. The image is never enlarged.
    """
    rows = np.arange(min(height, levels.shape[0])) * levels.shape[0] // min(height, levels.shape[0])
    columns = np.arange(min(width, levels.shape[1])) * levels.shape[1] // min(width, levels.shape[1])
    return np.maximum.reduceat(np.maximum.reduceat(levels, rows, axis=0), columns, axis=1)


def gray_ramp() -> UInt8[np.ndarray, "256"]:
    """Return the gray value of each level: unknown mid-gray, free white, occupied black."""
    ramp = np.interp(np.arange(256), [1, 128, 255], [255, UNKNOWN_GRAY, 0])
    ramp[0] = UNKNOWN_GRAY
    return ramp.astype(np.uint8)
