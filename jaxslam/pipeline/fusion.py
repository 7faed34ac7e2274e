"""Odometry fused with the IMU, in place of the odometry of the wheels."""

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
    """The fused motion at so many stamps (seconds, not decreasing), and how the IMU was read.

    Raises:
        LogError: the IMU tells nothing of turning.
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
    """The same scans, with increments and covariances of wheels and IMU fused.

    The covariances are for `GaussianMotion`; the other motion models have noise of their own.

    Args:
        scans: from `pair_scans` of that log.
        log: with odometry and an IMU.
        settings: what is read, and how much it is trusted; None for the defaults.

    Returns:
        The scans with the fused motion, `fused`, and how the IMU was read, `yaw`.

    Raises:
        LogError: the log has no IMU, or one that does not turn.
    """
    if log.imu is None:
        raise LogError(f"{log.path}: no IMU in it, so there is nothing to fuse (see `jaxslam info`)")
    settings = settings or FusionSettings()
    fused, yaw = fuse_tracks(settings, log.odometry, log.imu, scans.stamps)
    # A second time for the scans between: each question starts a new increment.
    everywhere, _ = fuse_tracks(settings, log.odometry, log.imu, scans.all_stamps)
    odometry = eqx.tree_at(
        lambda o: (o.delta, o.covariance),
        scans.inputs.odometry,
        (jnp.asarray(fused.deltas, jnp.float32), jnp.asarray(fused.covariances, jnp.float32)),
    )
    positions = everywhere.poses[:, :2]
    return dataclasses.replace(
        scans,
        inputs=eqx.tree_at(lambda i: i.odometry, scans.inputs, odometry),
        pose0=fused.poses[0],
        all_odometry=everywhere.poses,
        odometry_bounds=np.stack([positions.min(axis=0), positions.max(axis=0)]),
        fused=fused,
        yaw=yaw,
    )
