"""Odometry from the angles of two wheels."""

import numpy as np
from jaxtyping import Float64

from jaxslam.core import se2
from jaxslam.io.log import JointTrack, LogError, OdometryTrack


def wheel_odometry(joints: JointTrack, wheel_radius: float, track: float) -> OdometryTrack:
    """Integrate the wheel angles of a differential drive, each interval as an arc.

    Args:
        joints: angles in radians, with one joint whose name contains "left" and one with "right".
        wheel_radius: radius of both wheels, meters.
        track: distance between the wheels, meters.

    Raises:
        LogError: the track has no such pair of joints.
        ValueError: a length is not above 0.
    """
    for name, value in (("wheel radius", wheel_radius), ("track", track)):
        if not value > 0:
            raise ValueError(f"the {name} is {value} m: give a number of meters above 0")
    left, right = (_column(joints, side) for side in ("left", "right"))
    good = np.isfinite(left) & np.isfinite(right)
    stamps = joints.stamps[good]
    driven_left, driven_right = (wheel_radius * np.diff(angle[good]) for angle in (left, right))
    distance, turn = 0.5 * (driven_left + driven_right), (driven_right - driven_left) / track
    heading = np.concatenate([[0.0], np.cumsum(turn)])
    # The chord of an arc has the heading of its middle.
    chord = distance * np.sinc(turn / (2 * np.pi))
    middle = heading[:-1] + 0.5 * turn
    x, y = (np.concatenate([[0.0], np.cumsum(chord * part)]) for part in (np.cos(middle), np.sin(middle)))
    poses: Float64[np.ndarray, "M 3"] = np.stack([x, y, se2.wrap(heading)], axis=-1)
    return OdometryTrack(stamps, poses, np.full((len(stamps), 3), np.nan), joints.topic)


def _column(joints: JointTrack, side: str) -> Float64[np.ndarray, "M"]:
    found = [index for index, name in enumerate(joints.names) if side in name.lower()]
    if len(found) != 1:
        raise LogError(f"{joints.topic}: {len(found)} joints with {side!r} in their names, one is needed")
    return joints.positions[:, found[0]]
