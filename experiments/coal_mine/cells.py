"""A cell of either part. A spawned process could not import it from `__main__`."""

from experiments._harness.harness import Arrays, Cell
from experiments.coal_mine import localization, mapping


def run_cell(cell: Cell) -> Arrays:
    """Run a mapping or a localization cell."""
    return (mapping if "method" in cell.settings else localization).run_cell(cell)
