"""Lidar geometry: end points of beams and the normals of the walls they hit."""

from jaxslam.lidar.beams import ScanPoints, scan_points, spread_beams
from jaxslam.lidar.normals import surface_normals

__all__ = ["ScanPoints", "scan_points", "spread_beams", "surface_normals"]
