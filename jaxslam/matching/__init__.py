"""Scan matching: the pose at which a scan fits a map."""

from jaxslam.matching.correlative import CorrelativeSearch
from jaxslam.matching.gauss_newton import GaussNewton, PosePrior
from jaxslam.matching.heading import HeadingSearch

__all__ = ["CorrelativeSearch", "GaussNewton", "HeadingSearch", "PosePrior"]
