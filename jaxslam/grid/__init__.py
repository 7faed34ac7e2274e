"""Occupancy grids: where cells lie, what a scan does to them, how far obstacles are."""

from jaxslam.grid.distance import squared_distance
from jaxslam.grid.occupancy import (
    OccupancyModel,
    RangeTable,
    add_scan,
    is_occupied,
    probability,
    quantise,
    range_table,
)
from jaxslam.grid.spec import GridSpec
from jaxslam.grid.window import copy_maps, read_windows, window_origin, window_start, write_windows

__all__ = [
    "GridSpec",
    "OccupancyModel",
    "RangeTable",
    "add_scan",
    "copy_maps",
    "is_occupied",
    "probability",
    "quantise",
    "range_table",
    "read_windows",
    "squared_distance",
    "window_origin",
    "window_start",
    "write_windows",
]
