"""Rotation about the robot's vertical axis from an IMU in any mounting."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from jaxslam.core import se2
from jaxslam.core.trajectory import interpolate_poses
from jaxslam.io.log import ImuTrack, LogError, OdometryTrack

AXES: dict[str, tuple[float, float, float]] = {
    "x": (1.0, 0.0, 0.0),
    "y": (0.0, 1.0, 0.0),
    "z": (0.0, 0.0, 1.0),
    "-x": (-1.0, 0.0, 0.0),
    "-y": (0.0, -1.0, 0.0),
    "-z": (0.0, 0.0, -1.0),
}
"""Sensor axes that can point up, by their names in `--imu-yaw-axis`."""

_STILL_SPEED, _STILL_RATE = 0.01, 0.01
"""The robot counts as standing still if its odometry moves by less than this, m/s and rad/s."""
_LEAST_STILL = 20
"""Smallest number of readings at rest from which a bias is estimated."""
_LEVEL = 0.9
"""Share of the mean acceleration that must lie along one axis for the axis to be vertical."""


@dataclass(frozen=True)
class YawTrack:
    """Rotation about the vertical axis.

    Attributes:
        stamps: `[M]` seconds.
        rates: `[M]` rad/s, counter-clockwise seen from above; NaN if missing.
        headings: `[M]` rad, from an arbitrary zero; NaN if missing.
        axis: the sensor's axis that points up, `[3]`.
        source: how the axis was found, for display.
        bias: rad/s, subtracted from `rates`.
    """

    stamps: Float64[np.ndarray, "M"]
    rates: Float64[np.ndarray, "M"]
    headings: Float64[np.ndarray, "M"]
    axis: Float64[np.ndarray, "3"]
    source: str
    bias: float


def turning_is_known(imu: ImuTrack) -> bool:
    """Return whether an IMU has any turning rate."""
    return bool(np.isfinite(imu.angular_velocities).all(axis=1).any())


def yaw_track(imu: ImuTrack, odometry: OdometryTrack | None, axis: str | None = None) -> YawTrack:
    """Return an IMU's rotation about the vertical axis.

    Args:
        imu: readings in the sensor's frame.
        odometry: shows when the robot stands still, to estimate the bias of the gyro; None for no bias.
        axis: the sensor's axis that points up, a name in `AXES`. None takes the axis from the log's
            mounting, else from gravity, else z.

    Raises:
        LogError: the IMU has neither turning rates nor orientations.
    """
    up, source = _up_axis(imu, axis)
    rates = imu.angular_velocities @ up
    headings = _headings(imu.orientations, up)
    if not (np.isfinite(rates).any() or np.isfinite(headings).any()):
        raise LogError(f"{imu.topic}: the IMU has neither turning rates nor orientations")
    bias = 0.0
    if odometry is not None:
        still = _standing(imu.stamps, odometry) & np.isfinite(rates)
        if np.count_nonzero(still) >= _LEAST_STILL:
            bias = float(np.median(rates[still]))
    return YawTrack(imu.stamps, rates - bias, headings, up, source, bias)


def _up_axis(imu: ImuTrack, axis: str | None) -> tuple[Float64[np.ndarray, "3"], str]:
    if axis is not None:
        if axis not in AXES:
            raise LogError(f"--imu-yaw-axis is {axis!r}: give one of {', '.join(AXES)}")
        return np.array(AXES[axis]), "given"
    if imu.mounting_known:
        return imu.rotation_base_imu.T @ np.array(AXES["z"]), "the log's mounting"
    finite = imu.linear_accelerations[np.isfinite(imu.linear_accelerations).all(axis=1)]
    if len(finite):
        # An accelerometer at rest measures the upward reaction to gravity.
        mean = finite.mean(axis=0)
        share = np.abs(mean) / max(float(np.linalg.norm(mean)), 1e-9)
        strongest = int(np.argmax(share))
        if np.linalg.norm(mean) > 5.0 and share[strongest] > _LEVEL:
            up = np.zeros(3)
            up[strongest] = np.sign(mean[strongest])
            return up, "gravity"
    return np.array(AXES["z"]), "assumed"


def _headings(
    quaternions: Float64[np.ndarray, "M 4"], up: Float64[np.ndarray, "3"]
) -> Float64[np.ndarray, "M"]:
    """Return the heading of a level axis of the sensor, from its orientations."""
    level = np.eye(3)[int(np.argmin(np.abs(up)))]
    level = level - up * (level @ up)
    level = level / np.linalg.norm(level)
    x, y, z, w = quaternions.T
    norm = np.sqrt(x * x + y * y + z * z + w * w)
    with np.errstate(invalid="ignore", divide="ignore"):
        x, y, z, w = quaternions.T / norm
    turned_x = (
        (1 - 2 * (y * y + z * z)) * level[0] + 2 * (x * y - z * w) * level[1] + 2 * (x * z + y * w) * level[2]
    )
    turned_y = (
        2 * (x * y + z * w) * level[0] + (1 - 2 * (x * x + z * z)) * level[1] + 2 * (y * z - x * w) * level[2]
    )
    return np.where(norm > 0.5, np.arctan2(turned_y, turned_x), np.nan)


def _standing(stamps: Float64[np.ndarray, "M"], odometry: OdometryTrack) -> np.ndarray:
    """Return whether the odometry stands still around each stamp."""
    before = interpolate_poses(odometry.stamps, odometry.poses, stamps - 0.25)
    after = interpolate_poses(odometry.stamps, odometry.poses, stamps + 0.25)
    moved = se2.relative(before, after) / 0.5
    inside = (stamps >= odometry.stamps[0]) & (stamps <= odometry.stamps[-1])
    return inside & (np.hypot(moved[:, 0], moved[:, 1]) < _STILL_SPEED) & (np.abs(moved[:, 2]) < _STILL_RATE)
