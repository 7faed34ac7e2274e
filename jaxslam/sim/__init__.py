"""Simulator: worlds, a robot that drives through them, and what its sensors report."""

from jaxslam.sim.imu import Imu, Inertial
from jaxslam.sim.lidar import LIDARS, Lidar, lds_01, lds_02, rplidar_a1, sick, urg_04lx, vlp16_ring
from jaxslam.sim.odometry import Odometry, OdometryErrors, WheelOdometry
from jaxslam.sim.raster import observable, rasterise, reachable
from jaxslam.sim.raycast import cast_rays, cast_scan
from jaxslam.sim.roadway import Roadway, build_roadway, random_roadway, roadway
from jaxslam.sim.robot import Drive, Robot, drive, start_pose
from jaxslam.sim.simulate import Simulation, sample_times, simulate, to_log
from jaxslam.sim.world import World, box, disc, leg_clearances, place, polyline
from jaxslam.sim.worlds import WORLDS, hall_large, hall_small, make_world, random_hall

__all__ = [
    "LIDARS",
    "WORLDS",
    "Drive",
    "Imu",
    "Inertial",
    "Lidar",
    "Odometry",
    "OdometryErrors",
    "Roadway",
    "Robot",
    "Simulation",
    "WheelOdometry",
    "World",
    "box",
    "build_roadway",
    "cast_rays",
    "cast_scan",
    "disc",
    "drive",
    "hall_large",
    "hall_small",
    "lds_01",
    "lds_02",
    "leg_clearances",
    "make_world",
    "observable",
    "place",
    "polyline",
    "random_hall",
    "random_roadway",
    "rasterise",
    "reachable",
    "roadway",
    "rplidar_a1",
    "sample_times",
    "sick",
    "simulate",
    "start_pose",
    "to_log",
    "urg_04lx",
    "vlp16_ring",
]
