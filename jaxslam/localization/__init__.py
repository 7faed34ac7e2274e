"""Localization in a known map: adaptive Monte-Carlo localization and its parts."""

from jaxslam.localization.amcl import AMCL, Agreement, AMCLInfo, AMCLState
from jaxslam.localization.cluster import Cluster, Clustering
from jaxslam.localization.kld import Bins, KLDSampling
from jaxslam.localization.recovery import Averages, Recovery
from jaxslam.localization.skipping import BeamSkipping

__all__ = [
    "AMCL",
    "AMCLInfo",
    "AMCLState",
    "Agreement",
    "Averages",
    "BeamSkipping",
    "Bins",
    "Cluster",
    "Clustering",
    "KLDSampling",
    "Recovery",
]
