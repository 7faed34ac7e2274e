"""Occupancy grids: where cells lie, what a scan does to them, how far obstacles are."""

from jaxslam.grid.distance import squared_distance
from jaxslam.grid.obstacles import outstanding
from jaxslam.grid.occupancy import (
    CellsFromLidar,
    OccupancyModel,
    RangeTable,
    add_scan,
    cells_from_lidar,
    probability,
    quantise,
    range_table,
)
from jaxslam.grid.spec import GridSpec
from jaxslam.grid.window import (
    copy_maps,
    inside_window,
    read_windows,
    shift_to_scan,
    window_origin,
    window_start,
    write_windows,
)

__all__ = [
    "CellsFromLidar",
    "GridSpec",
    "OccupancyModel",
    "RangeTable",
    "add_scan",
    "cells_from_lidar",
    "copy_maps",
    "inside_window",
    "outstanding",
    "probability",
    "quantise",
    "range_table",
    "read_windows",
    "shift_to_scan",
    "squared_distance",
    "window_origin",
    "window_start",
    "write_windows",
]
