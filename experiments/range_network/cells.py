"""A cell of either part. A spawned process could not import it from `__main__`."""

from experiments._harness.harness import Arrays, Cell
from experiments.range_network import runs, training


def run_cell(cell: Cell) -> Arrays:
    """Run a training cell, or a cell of drives."""
    return (training if cell.settings["task"] == "training" else runs).run_cell(cell)
