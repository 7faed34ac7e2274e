"""Pictures: maps, paths, particles, error curves, animations; needs matplotlib and pillow."""

from jaxslam.viz.animation import MapFrame, animate_map
from jaxslam.viz.curves import plot_errors, plot_ess
from jaxslam.viz.maps import (
    MapImage,
    plot_covariance,
    plot_map,
    plot_particles,
    plot_scan,
    plot_trajectory,
)
from jaxslam.viz.picture import MapLayer, save_map_picture
from jaxslam.viz.raster import map_levels, shrink

__all__ = [
    "MapFrame",
    "MapImage",
    "MapLayer",
    "animate_map",
    "map_levels",
    "plot_covariance",
    "plot_errors",
    "plot_ess",
    "plot_map",
    "plot_particles",
    "plot_scan",
    "plot_trajectory",
    "save_map_picture",
    "shrink",
]
