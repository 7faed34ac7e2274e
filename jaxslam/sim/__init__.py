"""Simulator: worlds, a robot that drives through them, and what its sensors report."""

from jaxslam.sim.calibration import calibration_distances, calibration_run
from jaxslam.sim.exact_ranges import cast_rays
from jaxslam.sim.imu_sensor import Imu
from jaxslam.sim.lidar_sensor import Lidar, lds_01, lds_02, rplidar_a1, sick, urg_04lx, vlp16_ring
from jaxslam.sim.range_bias import RangeBias, draw_lds_01_bias, lds_01_accuracy
from jaxslam.sim.rasterize import observable, true_map
from jaxslam.sim.recording import Truth, drive
from jaxslam.sim.robot import Robot
from jaxslam.sim.simulate import Simulation, simulate, to_log
from jaxslam.sim.wheel_odometry import WheelOdometry
from jaxslam.sim.worlds.corridor import Corridor, build_corridor, corridor_loop, random_corridor
from jaxslam.sim.worlds.halls import WORLDS, hall_large, hall_small, make_world, random_hall
from jaxslam.sim.worlds.roadway import Roadway, build_roadway, random_roadway, roadway
from jaxslam.sim.worlds.world import World, box, disc, place, polyline

__all__ = [
    "WORLDS",
    "Corridor",
    "Imu",
    "Lidar",
    "RangeBias",
    "Roadway",
    "Robot",
    "Simulation",
    "Truth",
    "WheelOdometry",
    "World",
    "box",
    "build_corridor",
    "build_roadway",
    "calibration_distances",
    "calibration_run",
    "cast_rays",
    "corridor_loop",
    "disc",
    "draw_lds_01_bias",
    "drive",
    "hall_large",
    "hall_small",
    "lds_01",
    "lds_01_accuracy",
    "lds_02",
    "make_world",
    "observable",
    "place",
    "polyline",
    "random_corridor",
    "random_hall",
    "random_roadway",
    "roadway",
    "rplidar_a1",
    "sick",
    "simulate",
    "to_log",
    "true_map",
    "urg_04lx",
    "vlp16_ring",
]
