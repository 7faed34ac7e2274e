"""Measures of a result: trajectory errors (ATE, RPE), relation errors, map scores; NumPy only."""

from jaxslam.metrics.alignment import align_se2, associate
from jaxslam.metrics.map import BinaryMap, MapScore, map_score
from jaxslam.metrics.relations import RelationError, relation_errors, relation_residuals
from jaxslam.metrics.trajectory import (
    PoseErrors,
    TrajectoryError,
    absolute_trajectory_error,
    pose_errors,
    relative_pose_error,
)

__all__ = [
    "BinaryMap",
    "MapScore",
    "PoseErrors",
    "RelationError",
    "TrajectoryError",
    "absolute_trajectory_error",
    "align_se2",
    "associate",
    "map_score",
    "pose_errors",
    "relation_errors",
    "relation_residuals",
    "relative_pose_error",
]
