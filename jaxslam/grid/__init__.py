"""Occupancy grids: cell geometry, integration of scans, and distances to obstacles."""

from jaxslam.grid.field import DistanceField, Field, field_of_map
from jaxslam.grid.known_map import KnownMap
from jaxslam.grid.occupancy import OccupancyModel, quantize
from jaxslam.grid.raycast import cast
from jaxslam.grid.spec import GridSpec
from jaxslam.grid.walls import thin_walls

__all__ = [
    "DistanceField",
    "Field",
    "GridSpec",
    "KnownMap",
    "OccupancyModel",
    "cast",
    "field_of_map",
    "quantize",
    "thin_walls",
]
