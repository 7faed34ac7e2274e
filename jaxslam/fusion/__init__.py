"""Wheel odometry and IMU fused before the filter, by a Kalman filter."""

from jaxslam.fusion.ekf import EKF, Belief, Measurement, Updated
from jaxslam.fusion.fuse import Fused, filter_events, fuse
from jaxslam.fusion.imu import AXES, YawTrack, tells_turning, yaw_track
from jaxslam.fusion.stream import Events, ImuNoise, OdometerNoise, Stream, merge

__all__ = [
    "AXES",
    "EKF",
    "Belief",
    "Events",
    "Fused",
    "ImuNoise",
    "Measurement",
    "OdometerNoise",
    "Stream",
    "Updated",
    "YawTrack",
    "filter_events",
    "fuse",
    "merge",
    "tells_turning",
    "yaw_track",
]
