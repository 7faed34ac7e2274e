"""Convert a log on the host to the stacked arrays that a filter runs over."""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float64, Int

from jaxslam.config.localization import LocalizationConfig
from jaxslam.config.slam import SlamConfig
from jaxslam.config.thinning import Thinning
from jaxslam.core import se2
from jaxslam.core.trajectory import interpolate_poses
from jaxslam.core.types import LidarScan, OdometryIncrement, StepInputs
from jaxslam.fusion.fuse import FusedMotion
from jaxslam.fusion.imu import YawTrack
from jaxslam.io.log import LogError, OdometryTrack, SensorLog
from jaxslam.preprocess.deskew import SweepTiming

_TOLERANCE = 0.5
"""Time by which scans may lie outside the odometry, seconds."""


@dataclass(frozen=True)
class PreparedScans:
    """The scans of a log, thinned, corrected and paired with odometry: the input of a filter.

    Attributes:
        inputs: inputs of the filter, leaves stacked over the `T` processed scans.
        pose0: `[3]` odometry pose at the first processed scan (m, m, rad).
        stamps: `[T]` stamps of the processed scans, seconds.
        scan_index: `[T]` indices of the processed scans in the log.
        all_index: `[S]` indices in the log of all scans within the time span of the odometry.
        all_stamps: `[S]` stamps of these scans, seconds.
        all_odometry: `[S, 3]` odometry poses at these scans (m, m, rad).
        odometry_bounds: `[2, 2]` lower and upper corner of the odometry path, meters.
        odometry: odometry of the log.
        num_scans: number of scans in the log.
        config: complete configuration that the scans were prepared for, or None.
        timing: timing of the scans relative to the odometry; None if it cannot be estimated from the log.
        fused: motion fused from odometry and IMU at the processed scans; None if odometry alone was used.
        yaw: yaw rates of the IMU used for `fused`, or None.
    """

    inputs: StepInputs
    pose0: Float64[np.ndarray, "3"]
    stamps: Float64[np.ndarray, "T"]
    scan_index: Int[np.ndarray, "T"]
    all_index: Int[np.ndarray, "S"]
    all_stamps: Float64[np.ndarray, "S"]
    all_odometry: Float64[np.ndarray, "S 3"]
    odometry_bounds: Float64[np.ndarray, "2 2"]
    odometry: OdometryTrack
    num_scans: int = 0
    config: SlamConfig | LocalizationConfig | None = None
    timing: SweepTiming | None = None
    fused: FusedMotion | None = None
    yaw: YawTrack | None = None

    def __repr__(self) -> str:
        width, height = self.odometry_bounds[1] - self.odometry_bounds[0]
        parts = [
            f"{len(self.stamps)} of {self.num_scans} scans of {self.inputs.scan.num_beams} beams",
            f"odometry within {width:.1f} × {height:.1f} m",
        ]
        parts += [f"fused with {self.fused.readings['imu']} IMU readings"] if self.fused is not None else []
        return f"PreparedScans({', '.join(parts)})"


def pair_scans(log: SensorLog, thinning: Thinning) -> PreparedScans:
    """Thin the scans by motion, and pair each with the odometry since the previous processed scan.

    Args:
        log: log with scans and odometry.
        thinning: rule for which scans are processed.

    Raises:
        LogError: the log has no scans or no odometry, or the two do not overlap in time.
    """
    if log.scans is None or len(log.scans.stamps) == 0:
        raise LogError(f"{log.path}: the log has no laser scans: give a log with scans (see `jaxslam info`)")
    if log.odometry is None or len(log.odometry.stamps) == 0:
        raise LogError(f"{log.path}: no odometry in it: give a log with wheel odometry (see `jaxslam info`)")
    scans, odometry = log.scans, log.odometry
    first, last = odometry.stamps[0] - _TOLERANCE, odometry.stamps[-1] + _TOLERANCE
    candidates = np.flatnonzero((scans.stamps >= first) & (scans.stamps <= last))
    if candidates.size == 0:
        raise LogError(
            f"{log.path}: scans (from {scans.stamps[0]:.3f} s) and odometry (from "
            f"{odometry.stamps[0]:.3f} s) do not overlap in time: check the clocks that stamped them"
        )
    poses = interpolate_poses(odometry.stamps, odometry.poses, scans.stamps[candidates])
    kept = _moved_enough(poses, thinning)
    chosen, kept_poses, count = candidates[kept], poses[kept], len(kept)
    deltas = np.zeros((count, 3))
    deltas[1:] = se2.relative(kept_poses[:-1], kept_poses[1:])
    stamps = scans.stamps[chosen]
    ranges = scans.ranges[chosen]
    valid = np.isfinite(ranges) & (ranges >= 0.0)
    inputs = StepInputs(
        odometry=OdometryIncrement(
            delta=jnp.asarray(deltas, jnp.float32),
            covariance=jnp.zeros((count, 3, 3), jnp.float32),
            dt=jnp.asarray(np.diff(stamps, prepend=stamps[0]), jnp.float32),
        ),
        scan=LidarScan(
            ranges=jnp.asarray(np.where(valid, ranges, 0.0), jnp.float32),
            valid=jnp.asarray(valid),
            angle_min=jnp.asarray(scans.angle_min[chosen], jnp.float32),
            angle_increment=jnp.asarray(scans.angle_increment[chosen], jnp.float32),
            pose_base_lidar=jnp.asarray(np.tile(scans.pose_base_lidar, (count, 1)), jnp.float32),
        ),
    )
    positions = odometry.poses[:, :2]
    return PreparedScans(
        inputs=inputs,
        pose0=kept_poses[0],
        stamps=stamps,
        scan_index=chosen,
        all_index=candidates,
        all_stamps=scans.stamps[candidates],
        all_odometry=poses,
        odometry_bounds=np.stack([positions.min(axis=0), positions.max(axis=0)]),
        odometry=odometry,
        num_scans=len(scans.stamps),
    )


def _moved_enough(poses: Float64[np.ndarray, "S 3"], thinning: Thinning) -> Int[np.ndarray, "T"]:
    steps = se2.relative(poses[:-1], poses[1:])
    kept, translation, rotation = [0], 0.0, 0.0
    for index, (x, y, turn) in enumerate(steps, start=1):
        translation, rotation = translation + np.hypot(x, y), rotation + abs(turn)
        if translation >= thinning.min_translation or rotation >= thinning.min_rotation:
            kept.append(index)
            translation = rotation = 0.0
    return np.asarray(kept)
