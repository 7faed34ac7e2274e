"""Occupancy maps as small images: one byte of blackness per cell, cropped and shrunk without loss.

A map of 5 cm cells often has more cells than a picture has pixels. Averaging or skipping cells then
fades or drops one-cell walls, so pixels here take the *most occupied* cell that they cover.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Array, Shaped, UInt8

from jaxslam.grid.occupancy import LOG_ODDS_PER_UNIT

UNKNOWN_GRAY = 208
"""Gray of unknown cells, and of known ones that are as likely occupied as not; free is 255."""


@dataclass(frozen=True)
class Box:
    """A block of cells: rows `row` to `row_end`, columns `column` to `column_end`, exclusive."""

    row: int
    row_end: int
    column: int
    column_end: int

    def extent(self, resolution: float, origin: Shaped[np.ndarray, "2"]) -> tuple[float, float, float, float]:
        """Left, right, bottom and top of the block in the world, meters."""
        x, y = float(origin[0]), float(origin[1])
        return (
            x + self.column * resolution,
            x + self.column_end * resolution,
            y + self.row * resolution,
            y + self.row_end * resolution,
        )

    def cut(self, levels: Shaped[np.ndarray, "_ _"]) -> Shaped[np.ndarray, "_ _"]:
        """The cells of the block."""
        return levels[self.row : self.row_end, self.column : self.column_end]


def map_levels(occupancy: Shaped[np.ndarray | Array, "*shape"]) -> UInt8[np.ndarray, "H W"]:
    """Blackness of every cell: 0 where unknown, else 1 (surely free) to 255 (surely occupied).

    Args:
        occupancy: `[H, W]`, row 0 the lowest y. Floats are probabilities in [0, 1], unknown where
            NaN or exactly 0.5; int8 are the filter's fixed-point log-odds, unknown where 0; uint8
            are levels already and returned as they are.

    Raises:
        ValueError: if it is not a map of one of these kinds.
    """
    cells = np.asarray(occupancy)
    if cells.ndim != 2 or 0 in cells.shape:
        raise ValueError(f"the map has shape {cells.shape}: give [H, W] with at least one cell")
    if cells.dtype == np.uint8:
        return cells
    if cells.dtype == np.int8:
        return _log_odds_levels()[cells.view(np.uint8)]
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
    return np.where(known, _level(probability), 0).astype(np.uint8)


def shrink(levels: UInt8[np.ndarray, "_ _"], height: int, width: int) -> UInt8[np.ndarray, "_ _"]:
    """Pools to at most `[height, width]`: each pixel is the most occupied cell under it.

    A pixel is unknown only if all its cells are. Never enlarges.
    """
    rows = np.arange(min(height, levels.shape[0])) * levels.shape[0] // min(height, levels.shape[0])
    columns = np.arange(min(width, levels.shape[1])) * levels.shape[1] // min(width, levels.shape[1])
    return np.maximum.reduceat(np.maximum.reduceat(levels, rows, axis=0), columns, axis=1)


def known_box(levels: UInt8[np.ndarray, "H W"], margin: int = 0) -> Box:
    """The smallest block with every known cell, `margin` cells wider; all if none is known."""
    height, width = levels.shape
    rows, columns = np.flatnonzero(levels.any(axis=1)), np.flatnonzero(levels.any(axis=0))
    if rows.size == 0:
        return Box(0, height, 0, width)
    return Box(
        row=max(int(rows[0]) - margin, 0),
        row_end=min(int(rows[-1]) + 1 + margin, height),
        column=max(int(columns[0]) - margin, 0),
        column_end=min(int(columns[-1]) + 1 + margin, width),
    )


def gray_ramp() -> UInt8[np.ndarray, "256"]:
    """Gray value of each level: unknown mid-gray, free white, occupied black."""
    ramp = np.interp(np.arange(256), [1, 128, 255], [255, UNKNOWN_GRAY, 0])
    ramp[0] = UNKNOWN_GRAY
    return ramp.astype(np.uint8)


def _level(probability: Shaped[np.ndarray, "*shape"]) -> UInt8[np.ndarray, "*shape"]:
    return (1 + np.round(254 * probability)).astype(np.uint8)


def _log_odds_levels() -> UInt8[np.ndarray, "256"]:
    """Level of each int8 value, indexed by its bits."""
    log_odds = np.arange(256, dtype=np.uint8).view(np.int8) * LOG_ODDS_PER_UNIT
    levels = _level(1 / (1 + np.exp(-log_odds)))
    levels[0] = 0
    return levels
