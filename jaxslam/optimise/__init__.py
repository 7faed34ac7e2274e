"""Optimisation without gradients, of any fitness."""

from jaxslam.optimise.fruit_fly import Found, FruitFlies

__all__ = ["Found", "FruitFlies"]
