"""Motion models: where a particle may be after a step, given what the odometry saw."""

from jaxslam.motion.base import AbstractMotionModel
from jaxslam.motion.gaussian import GaussianMotion
from jaxslam.motion.odometry import OdometryMotion
from jaxslam.motion.omnidirectional import OmnidirectionalMotion
from jaxslam.motion.velocity import VelocityMotion

__all__ = [
    "AbstractMotionModel",
    "GaussianMotion",
    "OdometryMotion",
    "OmnidirectionalMotion",
    "VelocityMotion",
]
