"""Scan matching: the pose at which a scan fits a map."""

from jaxslam.matching.correlative import CorrelativeSearch
from jaxslam.matching.gauss_newton import GaussNewton, PosePrior
from jaxslam.matching.heading import HeadingSearch
from jaxslam.matching.icp import ICP, Alignment, rigid_fit
from jaxslam.matching.swarm import FruitFlies

__all__ = [
    "ICP",
    "Alignment",
    "CorrelativeSearch",
    "FruitFlies",
    "GaussNewton",
    "HeadingSearch",
    "PosePrior",
    "rigid_fit",
]
