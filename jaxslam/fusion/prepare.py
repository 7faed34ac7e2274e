"""Fused odometry in the place of the wheels' in a filter's inputs."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxslam.fusion.ekf import EKF
from jaxslam.fusion.fuse import Fused, fuse
from jaxslam.fusion.imu import yaw_track
from jaxslam.fusion.stream import ImuNoise, OdometerNoise, merge
from jaxslam.inputs import PreparedInputs
from jaxslam.io.log import LogError, SensorLog


def with_fused_odometry(
    prepared: PreparedInputs,
    log: SensorLog,
    ekf: EKF | None = None,
    odometer_noise: OdometerNoise | None = None,
    imu_noise: ImuNoise | None = None,
    imu_yaw_axis: str | None = None,
) -> tuple[PreparedInputs, Fused]:
    """The same scans, with increments and covariances of wheels and IMU fused.

    The covariances are for `GaussianMotion`; the other motion models have noise of their own.

    Args:
        prepared: from `prepare_inputs` of that log.
        log: with odometry and an IMU.
        ekf: the filter; None for the default one, as for the noises.
        odometer_noise: of the wheels.
        imu_noise: of the IMU.
        imu_yaw_axis: of the IMU that points up, as for `yaw_track`.

    Returns:
        The inputs, and what was fused at the processed scans.

    Raises:
        LogError: the log has no IMU, or one that does not turn.
    """
    if log.imu is None:
        raise LogError(f"{log.path}: no IMU in it, so there is nothing to fuse (see `jaxslam info`)")
    yaw = yaw_track(log.imu, log.odometry, imu_yaw_axis)
    noises = odometer_noise or OdometerNoise(), imu_noise or ImuNoise()
    ekf = ekf or EKF()
    fused = fuse(ekf, merge(log.odometry, yaw, prepared.stamps, *noises))
    # A second time for the scans between: each question starts a new increment.
    everywhere = fuse(ekf, merge(log.odometry, yaw, prepared.all_stamps, *noises))
    odometry = eqx.tree_at(
        lambda o: (o.delta, o.covariance),
        prepared.inputs.odometry,
        (jnp.asarray(fused.deltas, jnp.float32), jnp.asarray(fused.covariances, jnp.float32)),
    )
    positions = everywhere.poses[:, :2]
    replaced = dataclasses.replace(
        prepared,
        inputs=eqx.tree_at(lambda i: i.odometry, prepared.inputs, odometry),
        pose0=fused.poses[0],
        all_odometry=everywhere.poses,
        odometry_bounds=np.stack([positions.min(axis=0), positions.max(axis=0)]),
    )
    return replaced, fused
