"""Wheel odometry and IMU fused before the filter, by a Kalman filter."""

from jaxslam.fusion.ekf import EKF, Belief, Measurement, Updated
from jaxslam.fusion.fuse import Fused, filter_events, fuse
from jaxslam.fusion.imu import AXES, YawTrack, tells_turning, yaw_track
from jaxslam.fusion.prepare import fuse_tracks, with_fused_odometry
from jaxslam.fusion.settings import FusionSettings
from jaxslam.fusion.stream import Events, ImuNoise, OdometerNoise, Stream, merge

__all__ = [
    "AXES",
    "EKF",
    "Belief",
    "Events",
    "Fused",
    "FusionSettings",
    "ImuNoise",
    "Measurement",
    "OdometerNoise",
    "Stream",
    "Updated",
    "YawTrack",
    "filter_events",
    "fuse",
    "fuse_tracks",
    "merge",
    "tells_turning",
    "with_fused_odometry",
    "yaw_track",
]
