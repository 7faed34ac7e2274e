"""Vectorised Rao-Blackwellized particle-filter SLAM for 2D lidar, in JAX."""
