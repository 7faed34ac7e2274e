"""Fusion of wheel odometry and IMU by a Kalman filter, before SLAM or localization."""

from jaxslam.fusion.ekf import EKF, Belief, Measurement
from jaxslam.fusion.fuse import FusedMotion, fuse
from jaxslam.fusion.imu import YawTrack, yaw_track
from jaxslam.fusion.stream import ImuNoise, OdometerNoise, Stream, merge

__all__ = [
    "EKF",
    "Belief",
    "FusedMotion",
    "ImuNoise",
    "Measurement",
    "OdometerNoise",
    "Stream",
    "YawTrack",
    "fuse",
    "merge",
    "yaw_track",
]
