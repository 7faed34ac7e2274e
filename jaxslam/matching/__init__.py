"""Scan matching: the pose at which a scan fits a map."""

from jaxslam.matching.correlative import CorrelativeSearch
from jaxslam.matching.gauss_newton import GaussNewton, PosePrior

__all__ = ["CorrelativeSearch", "GaussNewton", "PosePrior"]
