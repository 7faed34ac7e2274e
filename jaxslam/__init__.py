"""Vectorised Rao-Blackwellized particle-filter SLAM for 2D lidar, in JAX.

The names of a first session are here; every other one is in the subpackage that it belongs to. Importing
this needs jax, equinox, numpy and jaxtyping only: pictures (`jaxslam.viz`) and the command line
(`jaxslam.cli`) are imported by name, and files that need another library import it when they are opened.
"""

from importlib.metadata import version

from jaxslam import grid, io, lidar, matching, metrics, motion, proposal, resampling, se2, sensor, sim, slam
from jaxslam.flags import Flag
from jaxslam.grid import GridSpec, OccupancyModel
from jaxslam.inputs import PreparedInputs, Thinning, prepare_inputs
from jaxslam.io import LogError, SensorLog, read_log
from jaxslam.slam import RBPF, RBPFState, StepInfo, trajectory
from jaxslam.types import LidarScan, OdometryIncrement, StepInputs

__version__ = version("jaxslam")

__all__ = [
    "RBPF",
    "Flag",
    "GridSpec",
    "LidarScan",
    "LogError",
    "OccupancyModel",
    "OdometryIncrement",
    "PreparedInputs",
    "RBPFState",
    "SensorLog",
    "StepInfo",
    "StepInputs",
    "Thinning",
    "__version__",
    "grid",
    "io",
    "lidar",
    "matching",
    "metrics",
    "motion",
    "prepare_inputs",
    "proposal",
    "read_log",
    "resampling",
    "se2",
    "sensor",
    "sim",
    "slam",
    "trajectory",
]
