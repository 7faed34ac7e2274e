"""Problems that a jitted step can report, as bits of one integer."""

import enum


class Flag(enum.IntFlag):
    """Bits of `StepInfo.flags`; `jaxslam.pipeline.run` turns them into errors and warnings on the host."""

    OFF_MAP = enum.auto()
    """A particle's window crossed the edge of the map, so part of its scan was not mapped."""
    NONFINITE_WEIGHT = enum.auto()
    """A particle's weight was NaN or infinite; the particle was given weight zero."""
    NONFINITE_POSE = enum.auto()
    """A particle's pose was NaN or infinite; the particle kept its predicted pose."""
    FEW_VALID_BEAMS = enum.auto()
    """The scan had too few valid beams to localize with: the pose comes from odometry alone."""
    SEARCHED = enum.auto()
    """The matcher found too few inliers for at least one particle and searched a wider area."""
    MATCH_FAILED = enum.auto()
    """The match of at least one particle had too few inliers; the motion model sampled its pose instead."""
