"""Replace wheel odometry with odometry fused with the IMU."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float64

from jaxslam.config.fusion import FusionSettings
from jaxslam.fusion.fuse import FusedMotion, fuse
from jaxslam.fusion.imu import YawTrack, yaw_track
from jaxslam.fusion.stream import merge
from jaxslam.io.log import ImuTrack, LogError, OdometryTrack, SensorLog
from jaxslam.pipeline.inputs import PreparedScans


def fuse_tracks(
    settings: FusionSettings,
    odometry: OdometryTrack | None,
    imu: ImuTrack,
    stamps: Float64[np.ndarray, "Q"],
) -> tuple[FusedMotion, YawTrack]:
    """Fuse odometry and IMU.

    Args:
        settings: fusion settings.
        odometry: wheel odometry, or None to use the IMU alone.
        imu: IMU readings.
        stamps: `[Q]` times of the fused poses, seconds, not decreasing.

    Returns:
        The fused motion at the stamps, and the yaw rates of the IMU with its vertical axis and bias.

    Raises:
        LogError: the IMU has no angular velocities.
    """
    yaw = yaw_track(imu, odometry, None if settings.yaw_axis == "auto" else settings.yaw_axis)
    stream = merge(
        odometry,
        yaw,
        stamps,
        settings.odometer,
        settings.imu,
        use_poses=settings.read_poses,
        use_headings=settings.read_headings,
        world_frame=settings.ekf.frame == "world",
    )
    return fuse(settings.ekf, stream), yaw


def with_fused_odometry(
    scans: PreparedScans, log: SensorLog, settings: FusionSettings | None = None
) -> PreparedScans:
    """Return the scans with odometry increments and covariances fused from wheels and IMU.

    Only `GaussianMotion` uses the covariances; the other motion models define their own noise.

    Args:
        scans: scans of the log, from `pair_scans`.
        log: log with odometry and an IMU.
        settings: fusion settings; None for the defaults.

    Returns:
        The scans, including the fused motion as `fused` and the yaw rates of the IMU as `yaw`.

    Raises:
        LogError: the log has no IMU, or its IMU has no angular velocities.
    """
    if log.imu is None:
        raise LogError(f'{log.path}: no IMU in it, so there is nothing to fuse: set fusion.use to "off"')
    settings = settings or FusionSettings()
    fused, yaw = fuse_tracks(settings, log.odometry, log.imu, scans.stamps)
    # Fuse again at the stamps of all scans, because each stamp starts a new increment.
    everywhere, _ = fuse_tracks(settings, log.odometry, log.imu, scans.all_stamps)
    inputs = eqx.tree_at(
        lambda i: (i.odometry.delta, i.odometry.covariance),
        scans.inputs,
        (jnp.asarray(fused.deltas, jnp.float32), jnp.asarray(fused.covariances, jnp.float32)),
    )
    positions = everywhere.poses[:, :2]
    return dataclasses.replace(
        scans,
        inputs=inputs,
        pose0=fused.poses[0],
        all_odometry=everywhere.poses,
        odometry_bounds=np.stack([positions.min(axis=0), positions.max(axis=0)]),
        fused=fused,
        yaw=yaw,
    )
