"""What can go wrong inside a jitted step, as bits of one integer."""

import enum


class Flag(enum.IntFlag):
    """Bits of `StepInfo.flags`; `jaxslam.pipeline.run` turns them into errors and warnings on the host."""

    OFF_MAP = enum.auto()
    """A particle's window reached over the edge of the map: part of what it saw was not mapped."""
    NONFINITE_WEIGHT = enum.auto()
    """A particle's weight was NaN or infinite; the particle was given weight zero."""
    NONFINITE_POSE = enum.auto()
    """A particle's pose was NaN or infinite; it kept its predicted pose."""
    FEW_VALID_BEAMS = enum.auto()
    """The scan had too few returns to say anything: the pose is odometry alone."""
    SEARCHED = enum.auto()
    """The matcher had lost the map for at least one particle and searched a wider area."""
    MATCH_FAILED = enum.auto()
    """The match of at least one particle explained too little of the scan: the motion model moved it."""
