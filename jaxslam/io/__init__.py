"""Files: read logs (CARMEN, ROS bags); read and write trajectories, relations and maps.

Importing this package needs NumPy only; rosbags, SciPy, ruamel.yaml and Pillow are imported when a file
that needs them is opened.
"""

from jaxslam.io.bag.reader import read_bag
from jaxslam.io.carmen.reader import read_carmen
from jaxslam.io.log import FixTrack, ImuTrack, JointTrack, LogError, OdometryTrack, ScanTrack, SensorLog
from jaxslam.io.map_server import MapError, OccupancyMap, read_map, write_map
from jaxslam.io.reader import read_log
from jaxslam.io.relations import Relations, read_relations
from jaxslam.io.summary import summarize
from jaxslam.io.tum import read_tum, write_tum

__all__ = [
    "FixTrack",
    "ImuTrack",
    "JointTrack",
    "LogError",
    "MapError",
    "OccupancyMap",
    "OdometryTrack",
    "Relations",
    "ScanTrack",
    "SensorLog",
    "read_bag",
    "read_carmen",
    "read_log",
    "read_map",
    "read_relations",
    "read_tum",
    "summarize",
    "write_map",
    "write_tum",
]
