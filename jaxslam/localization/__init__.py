"""Localisation in a known map: adaptive Monte-Carlo localisation and its parts."""

from jaxslam.localization.amcl import AMCL, Agreement, AMCLInfo, AMCLState, run
from jaxslam.localization.cluster import Cluster, Clustering
from jaxslam.localization.kld import Bins, KLDSampling
from jaxslam.localization.known_map import KnownMap
from jaxslam.localization.recovery import Averages, Recovery
from jaxslam.localization.scan_model import AbstractScanModel, BeamModel, BeamSkipping, FieldModel

__all__ = [
    "AMCL",
    "AMCLInfo",
    "AMCLState",
    "AbstractScanModel",
    "Agreement",
    "Averages",
    "BeamModel",
    "BeamSkipping",
    "Bins",
    "Cluster",
    "Clustering",
    "FieldModel",
    "KLDSampling",
    "KnownMap",
    "Recovery",
    "run",
]
