"""A simulated drive as a log with its ground truth, in one call."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, PRNGKeyArray

from jaxslam.core.validation import require_keys
from jaxslam.io.log import SensorLog
from jaxslam.sim.imu_sensor import Imu
from jaxslam.sim.lidar_sensor import Lidar
from jaxslam.sim.robot import Robot
from jaxslam.sim.simulate import simulate, to_log
from jaxslam.sim.wheel_odometry import WheelOdometry
from jaxslam.sim.worlds.halls import make_world
from jaxslam.sim.worlds.world import Site, World


@dataclass(frozen=True)
class Truth:
    """The ground truth of a simulated drive.

    Attributes:
        stamps: `[T]` stamps of the scans, seconds.
        poses: `[T, 3]` true base poses at the stamps (m, m, rad, world frame).
        world: the world of the drive.
    """

    stamps: Float64[np.ndarray, "T"]
    poses: Float64[np.ndarray, "T 3"]
    world: World

    @property
    def walls(self) -> Float64[np.ndarray, "S 4"]:
        """Return the end points `[S, 4]` x1, y1, x2, y2 of the walls, meters."""
        return np.asarray(self.world.segments, np.float64)

    def __repr__(self) -> str:
        return f"Truth({len(self.stamps)} poses in {self.world.name!r})"


def drive(
    world: str | Site = "hall_small",
    *,
    key: PRNGKeyArray,
    duration: float = 200.0,
    robot: Robot | None = None,
    wheels: WheelOdometry | None = None,
    imu: Imu | None = None,
    lidar: Lidar | None = None,
) -> tuple[SensorLog, Truth]:
    """Drive a robot through a world and return its log and the ground truth.

    Args:
        world: a name in `jaxslam.sim.WORLDS`, or a world and the way-points `[W, 2]` of a closed tour,
            meters.
        key: PRNG key of all sensor errors; same key, same bytes.
        duration: seconds; a tour of a hall takes almost 200.
        robot: limits and steering; None for the defaults, as for the sensors.
        wheels: encoders and their errors.
        imu: noise and biases.
        lidar: beams and noise; None is a SICK LMS-200 with 181 beams.

    Returns:
        The log and the ground truth. The odometry starts at the true pose, so that a map made from the log is
        aligned with the world.

    Raises:
        ValueError: the world is unknown, a leg of the tour comes too near to a wall, or the drive is too
            short for one scan.
    """
    require_keys("drive", key, 0, "jax.random.key(0)")
    place, waypoints = make_world(world) if isinstance(world, str) else world
    simulation = simulate(
        key, place, waypoints, robot=robot, wheels=wheels, imu=imu, lidar=lidar, duration=duration
    )
    log = to_log(simulation, place.name, in_world_frame=True)
    assert log.scans is not None  # every simulated robot has a lidar
    return log, Truth(log.scans.stamps, np.asarray(simulation.scan_poses, np.float64), place)
