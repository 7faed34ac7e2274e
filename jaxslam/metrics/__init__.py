"""Measures of a result: trajectories, relations, maps, loops. NumPy; `match_features` needs scikit-image."""

from jaxslam.metrics.alignment import align_se2, associate
from jaxslam.metrics.features import FeatureMatch, match_features
from jaxslam.metrics.loop import LoopClosure, loop_closed
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
    "FeatureMatch",
    "LoopClosure",
    "MapScore",
    "PoseErrors",
    "RelationError",
    "TrajectoryError",
    "absolute_trajectory_error",
    "align_se2",
    "associate",
    "loop_closed",
    "map_score",
    "match_features",
    "pose_errors",
    "relation_errors",
    "relation_residuals",
    "relative_pose_error",
]
