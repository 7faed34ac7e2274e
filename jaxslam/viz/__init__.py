"""Draw maps, paths, particles, curves and animations; needs matplotlib and pillow."""

from jaxslam.core.names import optional_import

with optional_import():
    from jaxslam.viz.animation import InlineAnimation, MapFrame, animate_inline, animate_map
    from jaxslam.viz.curves import plot_errors, plot_ess
    from jaxslam.viz.maps import plot_map, plot_particles, plot_scan, plot_trajectory, plot_walls
    from jaxslam.viz.picture import MapLayer, save_map_picture
    from jaxslam.viz.raster import map_levels, shrink
    from jaxslam.viz.results import plot_run

__all__ = [
    "InlineAnimation",
    "MapFrame",
    "MapLayer",
    "animate_inline",
    "animate_map",
    "map_levels",
    "plot_errors",
    "plot_ess",
    "plot_map",
    "plot_particles",
    "plot_run",
    "plot_scan",
    "plot_trajectory",
    "plot_walls",
    "save_map_picture",
    "shrink",
]
