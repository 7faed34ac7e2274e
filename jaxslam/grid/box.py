"""The smallest block of cells that contains everything known in a map."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Shaped


@dataclass(frozen=True)
class Box:
    """A block of cells: rows `row` to `row_end`, columns `column` to `column_end`, exclusive."""

    row: int
    row_end: int
    column: int
    column_end: int

    def extent(self, resolution: float, origin: Shaped[np.ndarray, "2"]) -> tuple[float, float, float, float]:
        """Return left, right, bottom and top of the block in the world, meters."""
        x, y = float(origin[0]), float(origin[1])
        return (
            x + self.column * resolution,
            x + self.column_end * resolution,
            y + self.row * resolution,
            y + self.row_end * resolution,
        )

    def cut(self, cells: Shaped[np.ndarray, "_ _"]) -> Shaped[np.ndarray, "_ _"]:
        """Return the cells of the block."""
        return cells[self.row : self.row_end, self.column : self.column_end]


def known_box(cells: Shaped[np.ndarray, "H W"], margin: int = 0) -> Box:
    """Return the smallest block that contains every known cell, enlarged by a margin.

    Args:
        cells: `[H, W]` values that are 0 where a cell is unknown, such as int8 log-odds.
        margin: number of cells added on every side, as far as the map reaches.

    Returns:
        The block; the whole map if no cell is known.
    """
    height, width = cells.shape
    rows, columns = np.flatnonzero(cells.any(axis=1)), np.flatnonzero(cells.any(axis=0))
    if rows.size == 0:
        return Box(0, height, 0, width)
    return Box(
        row=max(int(rows[0]) - margin, 0),
        row_end=min(int(rows[-1]) + 1 + margin, height),
        column=max(int(columns[0]) - margin, 0),
        column_end=min(int(columns[-1]) + 1 + margin, width),
    )
