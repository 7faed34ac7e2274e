"""Small maps for the localization tests."""

import numpy as np

from jaxslam.grid import GridSpec
from jaxslam.io import OccupancyMap
from jaxslam.sim import hall_small
from jaxslam.sim.rasterize import rasterize


def hall_map(resolution=0.05):
    """The small hall as a map: its walls, and everything else inside them free."""
    world, waypoints = hall_small()
    spec = GridSpec.covering(np.array([-0.5, -0.5]), np.array([18.5, 15.5]), resolution)
    occupied = np.asarray(rasterize(world, spec))
    free = np.zeros_like(occupied)
    side = round(0.5 / resolution)
    free[side:-side, side:-side] = ~occupied[side:-side, side:-side]
    return OccupancyMap(occupied, free, resolution, np.array([-0.5, -0.5, 0.0])), world, waypoints


def room(*, origin=(0.0, 0.0, 0.0)):
    """A room of 3 × 2 m in cells of 0.5 m: walls all round, one free row of cells short of the top right."""
    occupied = np.ones((6, 8), bool)
    occupied[1:5, 1:7] = False
    occupied[4, 6] = True
    return OccupancyMap(occupied, ~occupied, 0.5, np.array(origin, float))
