"""Odometry and IMU as one time-ordered stream of readings."""

from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float64, Int

from jaxslam.core import se2
from jaxslam.core.validation import require_at_least_zero
from jaxslam.fusion.ekf import Measurement
from jaxslam.fusion.imu import YawTrack
from jaxslam.io.log import OdometryTrack

ODOMETRY, IMU, QUERY = 0, 1, 2
"""Source of an event. A query has no reading; it requests the motion since the previous query."""

_LONGEST_STEP = 1.0
"""Odometry poses further apart than this, seconds, give no rates."""


class OdometerNoise(eqx.Module):
    """Noise of the odometry, e_odom(d), Liang et al. (9).

    Attributes:
        speed: standard deviation of the forward speed, as a share of the speed.
        speed_floor: standard deviation of the forward speed at rest, m/s.
        lateral: standard deviation of the lateral speed, m/s, since wheels slip slightly sideways.
        turning: standard deviation of the turning rate, as a share of the rate.
        turning_floor: standard deviation of the turning rate at rest, rad/s.
        position_per_meter: standard deviation of the position, m per √m driven.
        heading_per_meter: standard deviation of the heading, rad per √m driven.
    """

    speed: float = 0.05
    speed_floor: float = 0.02
    lateral: float = 0.02
    turning: float = 0.3
    turning_floor: float = 0.1
    position_per_meter: float = 0.05
    heading_per_meter: float = 0.05

    def __check_init__(self):
        require_at_least_zero(self, positive=("speed_floor", "lateral", "turning_floor"))


class ImuNoise(eqx.Module):
    """Noise of an IMU, Liang et al. (10).

    Attributes:
        rate: standard deviation of the turning rate, rad/s.
        heading: standard deviation of the heading, rad.
    """

    rate: float = 0.02
    heading: float = 0.05

    def __check_init__(self):
        require_at_least_zero(self, positive=("rate", "heading"))


class Events(eqx.Module):
    """Readings and queries, stacked over time, `[M, ...]`.

    Attributes:
        dt: seconds since the previous event.
        measurement: the reading; a query has no `seen` component.
        source: `ODOMETRY`, `IMU` or `QUERY`.
    """

    dt: Float[Array, "*M"]
    measurement: Measurement
    source: Int[Array, "*M"]


@dataclass(frozen=True)
class Stream:
    """Events and the data that the host needs to interpret their results.

    Attributes:
        events: time-ordered; at equal stamps readings come before queries.
        stamps: `[M]` seconds.
        start: `[3]` odometry pose at the first event.
        query_rows: `[Q]` rows of the queries, in order.
    """

    events: Events
    stamps: Float64[np.ndarray, "M"]
    start: Float64[np.ndarray, "3"]
    query_rows: Int[np.ndarray, "Q"]


def merge(
    odometry: OdometryTrack | None,
    yaw: YawTrack | None,
    queries: Float64[np.ndarray, "Q"],
    odometer_noise: OdometerNoise,
    imu_noise: ImuNoise,
    *,
    use_poses: bool = False,
    use_headings: bool = False,
    world_frame: bool = False,
) -> Stream:
    """Merge sensor readings and queries into one stream.

    The rates of the odometry are computed from its poses: every log has poses, and outliers in the velocities
    that a driver reports do not affect them.

    Args:
        odometry: poses, or None.
        yaw: rotation from the IMU, or None.
        queries: `[Q]` stamps, seconds, not decreasing, at which to return the motion since the previous one.
        odometer_noise: noise of the odometry.
        imu_noise: noise of the IMU.
        use_poses: read the odometry's poses in addition to its rates, with a covariance that grows with the
            distance, as in (9). The errors of poses and rates are not independent.
        use_headings: read the IMU's headings in addition to its rates.
        world_frame: take rates along the world's axes instead of the robot's.

    Raises:
        ValueError: there is neither odometry nor an IMU.
    """
    parts = {QUERY: _query_part(queries)}
    start = np.zeros(3)
    if odometry is not None and len(odometry.stamps) > 0:
        start = odometry.poses[0]
        parts[ODOMETRY] = _odometry_part(odometry, odometer_noise, use_poses, world_frame)
    if yaw is not None and len(yaw.stamps) > 0:
        parts[IMU] = _imu_part(yaw, imu_noise, use_headings, float(start[2]))
    if len(parts) == 1:
        raise ValueError("there is neither odometry nor an IMU to fuse")
    stamps, value, variance, seen = (np.concatenate(column) for column in zip(*parts.values(), strict=True))
    source = np.concatenate([np.full(len(part[0]), code) for code, part in parts.items()])
    order = np.lexsort((source, stamps))
    stamps, source = stamps[order], source[order]
    return Stream(
        events=Events(
            dt=jnp.asarray(np.diff(stamps, prepend=stamps[:1]), jnp.float32),
            measurement=Measurement(
                jnp.asarray(value[order], jnp.float32),
                jnp.asarray(variance[order], jnp.float32),
                jnp.asarray(seen[order]),
            ),
            source=jnp.asarray(source, jnp.int32),
        ),
        stamps=stamps,
        start=start,
        query_rows=np.flatnonzero(source == QUERY),
    )


def _query_part(queries: Float64[np.ndarray, "Q"]):
    blank = np.zeros((len(queries), 6))
    return queries, blank, np.ones_like(blank), np.zeros_like(blank, bool)


def _odometry_part(odometry: OdometryTrack, noise: OdometerNoise, use_poses: bool, world_frame: bool):
    poses, stamps = odometry.poses, odometry.stamps
    step = se2.relative(poses[:-1], poses[1:])
    interval = np.diff(stamps)
    timed = (interval > 0) & (interval < _LONGEST_STEP)
    rates = step / np.where(timed, interval, 1.0)[:, None]
    value = np.concatenate([poses[1:], rates], axis=1)
    variance = np.ones_like(value)
    variance[:, 3] = noise.speed_floor**2 + (noise.speed * rates[:, 0]) ** 2
    variance[:, 4] = noise.lateral**2 + (noise.speed * rates[:, 1]) ** 2
    variance[:, 5] = noise.turning_floor**2 + (noise.turning * rates[:, 2]) ** 2
    distance = np.cumsum(np.hypot(step[:, 0], step[:, 1]))
    variance[:, :2] = (1e-4 + noise.position_per_meter**2 * distance)[:, None]
    variance[:, 2] = 1e-4 + noise.heading_per_meter**2 * distance
    if world_frame:
        # The axes of the rates turn with the robot, so both world axes get the larger variance.
        value[:, 3:5] = se2.rotate(poses[:-1, 2] + 0.5 * step[:, 2], rates[:, :2])
        variance[:, 3:5] = variance[:, 3:5].max(axis=1, keepdims=True)
    seen = np.zeros(value.shape, bool)
    seen[:, 3:] = timed[:, None]
    seen[:, :3] = use_poses
    # A rate belongs to the middle of its interval.
    return stamps[1:] if use_poses else stamps[1:] - 0.5 * interval, value, variance, seen


def _imu_part(yaw: YawTrack, noise: ImuNoise, use_headings: bool, start_heading: float):
    value = np.zeros((len(yaw.stamps), 6))
    seen = np.zeros(value.shape, bool)
    variance = np.ones_like(value)
    variance[:, 2], variance[:, 5] = noise.heading**2, noise.rate**2
    seen[:, 5] = np.isfinite(yaw.rates)
    value[:, 5] = np.where(seen[:, 5], yaw.rates, 0.0)
    if use_headings and np.isfinite(yaw.headings).any():
        first = yaw.headings[np.isfinite(yaw.headings)][0]
        seen[:, 2] = np.isfinite(yaw.headings)
        value[:, 2] = np.where(seen[:, 2], yaw.headings - first + start_heading, 0.0)
    return yaw.stamps, value, variance, seen
