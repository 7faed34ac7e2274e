"""Occupancy grids: geometry, scan integration, map windows, distance fields and ray casting."""

from jaxslam.grid.distance import squared_distance
from jaxslam.grid.field import DistanceField, Field, field_of_map, prepare_field, window_rows
from jaxslam.grid.known_map import KnownMap
from jaxslam.grid.occupancy import (
    CellsFromLidar,
    OccupancyModel,
    RangeTable,
    add_scan,
    cells_from_lidar,
    probability,
    quantize,
    range_table,
)
from jaxslam.grid.raycast import cast
from jaxslam.grid.spec import GridSpec
from jaxslam.grid.walls import thin_walls
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
    "KnownMap",
    "OccupancyModel",
    "RangeTable",
    "add_scan",
    "cast",
    "cells_from_lidar",
    "copy_maps",
    "field_of_map",
    "inside_window",
    "prepare_field",
    "probability",
    "quantize",
    "range_table",
    "read_windows",
    "shift_to_scan",
    "squared_distance",
    "thin_walls",
    "window_origin",
    "window_rows",
    "window_start",
    "write_windows",
]
