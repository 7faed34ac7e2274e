"""A small network that corrects the ranges of a cheap lidar, learnt in front of a wall.

What corrects is here; what trains, `jaxslam.range_network.learning`, needs the extra `train`.
"""

from jaxslam.range_network.file import load_network, save_network
from jaxslam.range_network.network import RangeNetwork

__all__ = ["RangeNetwork", "load_network", "save_network"]
