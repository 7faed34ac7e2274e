"""Sensor models: how likely a scan is at a pose in a map."""

from jaxslam.sensor.base import AbstractSensorModel
from jaxslam.sensor.beam import Beam
from jaxslam.sensor.endpoint import Endpoint
from jaxslam.sensor.field import DistanceField, Field, prepare_field, window_rows
from jaxslam.sensor.field_of_map import field_of_map
from jaxslam.sensor.likelihood_field import LikelihoodField
from jaxslam.sensor.raycast import cast

__all__ = [
    "AbstractSensorModel",
    "Beam",
    "DistanceField",
    "Endpoint",
    "Field",
    "LikelihoodField",
    "cast",
    "field_of_map",
    "prepare_field",
    "window_rows",
]
