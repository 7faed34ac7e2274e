"""A small neural network that corrects the ranges of a low-cost lidar, trained on readings of a wall.

This package applies the network; training, `jaxslam.range_network.learning`, needs the extra `train`.
"""

from jaxslam.range_network.network import RangeNetwork, load_network, save_network

__all__ = ["RangeNetwork", "load_network", "save_network"]
