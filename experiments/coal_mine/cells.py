"""A cell of either part. Not in `__main__`, where a process of its own would not find it."""

from experiments.coal_mine import localising, mapping
from experiments.harness import Arrays, Cell


def run_cell(cell: Cell) -> Arrays:
    """Maps, or localises."""
    return (mapping if "method" in cell.settings else localising).run_cell(cell)
