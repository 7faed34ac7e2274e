"""Jamaludin et al.: mapping a corridor with a cheap lidar, with and without the range network."""
