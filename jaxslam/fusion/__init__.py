"""Fusion of wheel odometry and IMU by a Kalman filter, before SLAM or localization."""

from jaxslam.fusion.ekf import EKF, Belief, EKFUpdate, Measurement
from jaxslam.fusion.fuse import FusedMotion, filter_events, fuse
from jaxslam.fusion.imu import AXES, YawTrack, turning_is_known, yaw_track
from jaxslam.fusion.stream import Events, ImuNoise, OdometerNoise, Stream, merge

__all__ = [
    "AXES",
    "EKF",
    "Belief",
    "EKFUpdate",
    "Events",
    "FusedMotion",
    "ImuNoise",
    "Measurement",
    "OdometerNoise",
    "Stream",
    "YawTrack",
    "filter_events",
    "fuse",
    "merge",
    "turning_is_known",
    "yaw_track",
]
