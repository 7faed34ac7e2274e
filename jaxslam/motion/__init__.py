"""Motion models: the distribution of a particle's next pose, given the odometry."""

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
