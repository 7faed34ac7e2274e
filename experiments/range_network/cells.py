"""A cell of either part. Not in `__main__`, where a process of its own would not find it."""

from experiments.harness import Arrays, Cell
from experiments.range_network import runs, training


def run_cell(cell: Cell) -> Arrays:
    """Trains, or drives."""
    return (training if cell.settings["task"] == "training" else runs).run_cell(cell)
