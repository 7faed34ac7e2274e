"""Lidar geometry: from ranges and bearings to points."""

from jaxslam.lidar.beams import ScanPoints, scan_points
from jaxslam.lidar.normals import surface_normals
from jaxslam.lidar.subset import spread_beams

__all__ = ["ScanPoints", "scan_points", "spread_beams", "surface_normals"]
