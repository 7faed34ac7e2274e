"""Sensor models: the likelihood of a scan at a pose in a map."""

from jaxslam.sensor.base import AbstractSensorModel
from jaxslam.sensor.beam import Beam
from jaxslam.sensor.endpoint import Endpoint
from jaxslam.sensor.likelihood_field import LikelihoodField
from jaxslam.sensor.nav2_field import Nav2Field

__all__ = [
    "AbstractSensorModel",
    "Beam",
    "Endpoint",
    "LikelihoodField",
    "Nav2Field",
]
