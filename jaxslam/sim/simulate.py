"""Simulation of a drive: true motion, wheel odometry, IMU and lidar, on the device and as a log."""

import math
from functools import partial
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float64, PRNGKeyArray, Shaped

from jaxslam.core import se2
from jaxslam.core.types import LidarScan
from jaxslam.io.log import ImuTrack, JointTrack, OdometryTrack, ScanTrack, SensorLog
from jaxslam.sim.imu_sensor import Imu, Inertial
from jaxslam.sim.lidar_sensor import Lidar, sick
from jaxslam.sim.robot import Drive, Robot, follow_tour
from jaxslam.sim.wheel_odometry import Odometry, WheelOdometry
from jaxslam.sim.worlds.world import World, leg_clearances

# Clearance of a tour beyond the robot's radius, meters: with the default steering, the robot deviates
# up to 0.10 m from a leg.
TOUR_MARGIN = 0.2


class Simulation(eqx.Module):
    """A drive and the readings of its sensors, each at its own times.

    Attributes:
        drive: the true motion at the robot's rate.
        odometry: the wheels' readings, from time 0 on.
        inertial: the IMU's samples.
        scans: `T` scans, `[T, B]`; instantaneous, without motion distortion.
        scan_poses: `[T, 3]` true base poses at the scans, world frame: the reference trajectory.
        wheels, imu, lidar: the models of the sensors.
        duration: seconds (static).
    """

    drive: Drive
    odometry: Odometry
    inertial: Inertial
    scans: LidarScan
    scan_poses: Float[Array, "*batch T 3"]
    wheels: WheelOdometry
    imu: Imu
    lidar: Lidar
    duration: float = eqx.field(static=True)

    @property
    def odometry_times(self) -> Float64[np.ndarray, "M"]:
        """Return seconds since the start, `[M]`."""
        return sample_times(self.wheels.rate, self.duration, phase=0.0)

    @property
    def imu_times(self) -> Float64[np.ndarray, "M"]:
        """Return seconds since the start, `[M]`."""
        return sample_times(self.imu.rate, self.duration, phase=0.5)

    @property
    def scan_times(self) -> Float64[np.ndarray, "T"]:
        """Return seconds since the start, `[T]`."""
        return sample_times(self.lidar.rate, self.duration, phase=0.5)


def sample_times(rate: float, duration: float, *, phase: float) -> Float64[np.ndarray, "M"]:
    """Return the times (i + phase) / rate within [0, duration], in seconds.

    Example:
        Rate 2 Hz, duration 1 s: 0, 0.5, 1 at phase 0; 0.25, 0.75 at phase 0.5.
    """
    # The tolerance keeps a sample that lies exactly at the end.
    count = math.floor(duration * rate - phase + 1e-9) + 1
    return (np.arange(count) + phase) / rate


def simulate(
    key: PRNGKeyArray,
    world: World,
    waypoints: Float64[np.ndarray, "W 2"],
    *,
    robot: Robot | None = None,
    wheels: WheelOdometry | None = None,
    imu: Imu | None = None,
    lidar: Lidar | None = None,
    duration: float = 200.0,
) -> Simulation:
    """Drive a robot round the closed tour `waypoints` `[W, 2]` (meters) and record its sensors' readings.

    Arguments as in `jaxslam.sim.drive`. The drive depends on the way-points only; the key draws all errors
    and noise. One compilation serves all keys, all worlds and tours of the same size and all floats of the
    models. The number of beams, the rates and the duration are static. Vmap over keys with the rest fixed.

    Raises:
        ValueError: if there are fewer than two way-points, two in a row are the same, a leg comes
            too near to a wall, or the drive is too short for one scan.
    """
    robot, lidar = robot or Robot(), lidar or sick()
    wheels, imu = wheels or WheelOdometry(), imu or Imu()
    _check(world, waypoints, robot, lidar, duration)
    return _simulate(key, world, jnp.asarray(waypoints, jnp.float32), robot, wheels, imu, lidar, duration)


@partial(jax.jit, static_argnames="duration")
def _simulate(
    key: PRNGKeyArray,
    world: World,
    waypoints: Float[Array, "W 2"],
    robot: Robot,
    wheels: WheelOdometry,
    imu: Imu,
    lidar: Lidar,
    duration: float,
) -> Simulation:
    key_wheels, key_imu, key_lidar = jax.random.split(key, 3)
    truth = follow_tour(robot, waypoints, math.ceil(duration * robot.rate))
    scan_poses, _ = truth.at(sample_times(lidar.rate, duration, phase=0.5))
    return Simulation(
        drive=truth,
        odometry=wheels.simulate(key_wheels, truth, sample_times(wheels.rate, duration, phase=0.0)),
        inertial=imu.simulate(key_imu, truth, sample_times(imu.rate, duration, phase=0.5)),
        scans=lidar.simulate(key_lidar, world, scan_poses),
        scan_poses=scan_poses,
        wheels=wheels,
        imu=imu,
        lidar=lidar,
        duration=duration,
    )


def to_log(
    simulation: Simulation,
    name: str = "simulation",
    *,
    start_stamp: float = 1.7e9,
    in_world_frame: bool = False,
) -> SensorLog:
    """Convert one drive, without batch axes, to a log, as if it had been read from a file (host).

    The IMU reports orientation and angular velocity about its z axis; linear acceleration is NaN.

    Args:
        simulation: the drive.
        name: name of the log, in place of a file's path.
        start_stamp: Unix time of the start, seconds.
        in_world_frame: start the odometry at the true pose instead of zero, so that a map made from the log
            is aligned with the world.
    """
    odometry_stamps = start_stamp + simulation.odometry_times
    poses = _host(simulation.odometry.poses)
    if in_world_frame:
        start = _host(simulation.drive.poses)[:1]
        poses = se2.compose(se2.compose(start, se2.inverse(poses[:1])), poses)
    odometry = OdometryTrack(
        stamps=odometry_stamps,
        poses=poses,
        twists=_host(simulation.odometry.twists),
        topic="odom",
    )
    angles = _host(simulation.odometry.wheel_angles)
    joints = JointTrack(
        stamps=odometry_stamps,
        names=("wheel_left_joint", "wheel_right_joint"),
        positions=angles,
        velocities=np.diff(angles, axis=0, prepend=angles[:1]) * simulation.wheels.rate,
        topic="joint_states",
    )
    imu = _imu_track(simulation, start_stamp)
    scans = _scan_track(simulation, start_stamp)
    counts = {track.topic: len(track.stamps) for track in (odometry, imu, joints, scans)}
    return SensorLog(path=Path(name), odometry=odometry, imu=imu, joints=joints, scans=scans, topics=counts)


def _imu_track(simulation: Simulation, start_stamp: float) -> ImuTrack:
    headings, yaw_rates = _host(simulation.inertial.headings), _host(simulation.inertial.yaw_rates)
    zero = np.zeros_like(headings)
    return ImuTrack(
        stamps=start_stamp + simulation.imu_times,
        orientations=np.stack([zero, zero, np.sin(headings / 2), np.cos(headings / 2)], axis=1),
        angular_velocities=np.stack([zero, zero, yaw_rates], axis=1),
        linear_accelerations=np.full((len(zero), 3), np.nan),
        rotation_base_imu=np.eye(3),
        mounting_known=True,
        topic="imu",
    )


def _scan_track(simulation: Simulation, start_stamp: float) -> ScanTrack:
    scans = simulation.scans
    return ScanTrack(
        stamps=start_stamp + simulation.scan_times,
        ranges=np.where(scans.valid, scans.ranges, np.float32(np.nan)),
        num_beams=np.full(len(scans.ranges), scans.num_beams),
        angle_min=_host(scans.angle_min),
        angle_increment=_host(scans.angle_increment),
        range_min=float(simulation.lidar.range_min),
        range_max=float(simulation.lidar.range_max),
        pose_base_lidar=_host(scans.pose_base_lidar)[0],
        mounting_known=True,
        topic="scan",
        time_increment=0.0,
    )


def _host(values: Shaped[Array, "*any"]) -> Shaped[np.ndarray, "*any"]:
    return np.asarray(values, np.float64)


def _check(
    world: World, waypoints: Float64[np.ndarray, "W 2"], robot: Robot, lidar: Lidar, duration: float
) -> None:
    if len(waypoints) < 2:
        raise ValueError(f"a tour needs at least two way-points, not {len(waypoints)}")
    lengths = np.linalg.norm(np.roll(waypoints, -1, axis=0) - waypoints, axis=1)
    if not (np.isfinite(lengths).all() and (lengths > 0).all()):
        leg = int(np.argmin(np.where(np.isfinite(lengths), lengths, -1.0)))
        raise ValueError(
            f"way-point {leg} and the one after it are {lengths[leg]} m apart: give finite "
            "way-points, none twice in a row, and do not repeat the first (the tour is closed)"
        )
    if not duration * lidar.rate >= 0.5:
        raise ValueError(
            f"duration is {duration} s, too short for one scan at {lidar.rate} Hz: simulate longer"
        )
    # Traced worlds or robots have no values to check.
    if isinstance(world.segments, jax.core.Tracer) or isinstance(robot.radius, jax.core.Tracer):
        return
    clearances = leg_clearances(np.asarray(world.segments, np.float64), waypoints)
    needed = float(robot.radius) + TOUR_MARGIN
    if clearances.min() < needed:
        leg = int(clearances.argmin())
        raise ValueError(
            f"the leg from way-point {leg} {waypoints[leg].tolist()} comes within "
            f"{clearances[leg]:.2f} m of a wall of {world.name!r}: a robot of radius "
            f"{float(robot.radius)} m needs {needed:.2f} m, move the way-points"
        )
