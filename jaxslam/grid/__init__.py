"""Occupancy grids: where cells lie, what a scan does to them, how far obstacles are."""

from jaxslam.grid.distance import squared_distance
from jaxslam.grid.field import DistanceField, Field, field_of_map, prepare_field, window_rows
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
from jaxslam.grid.raycast import cast
from jaxslam.grid.spec import GridSpec
from jaxslam.grid.walls import outstanding
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
    "DistanceField",
    "Field",
    "GridSpec",
    "OccupancyModel",
    "RangeTable",
    "add_scan",
    "cells_from_lidar",
    "cast",
    "copy_maps",
    "field_of_map",
    "inside_window",
    "outstanding",
    "prepare_field",
    "probability",
    "quantise",
    "range_table",
    "read_windows",
    "shift_to_scan",
    "squared_distance",
    "window_origin",
    "window_rows",
    "window_start",
    "write_windows",
]
