"""Ground-truth relations of the SLAM benchmark: relative poses between pairs of stamps.

Kümmerle et al., On measuring the accuracy of SLAM algorithms, Autonomous Robots 27, 2009.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from jaxslam.core import se2
from jaxslam.io.log import LogError
from jaxslam.io.tum import read_number_rows


@dataclass(frozen=True)
class Relations:
    """Relative poses known from the ground truth.

    Attributes:
        stamps_from: `[R]` seconds, time of pose i.
        stamps_to: `[R]` seconds, time of pose j.
        deltas: `[R, 3]` pose of j in the frame of i (m, m, rad).
    """

    stamps_from: Float64[np.ndarray, "R"]
    stamps_to: Float64[np.ndarray, "R"]
    deltas: Float64[np.ndarray, "R 3"]


def read_relations(path: str | Path) -> Relations:
    """Read relations, `t1 t2 x y z roll pitch yaw` a line.

    Args:
        path: file to read. Lines that start with `#` are comments; z, roll and pitch are not used.

    Returns:
        The relations in the order of the file.

    Raises:
        LogError: the file is missing or empty, or a line is not a relation (the message has its number).
    """
    table, _ = read_number_rows(Path(path), 8, "t1 t2 x y z roll pitch yaw")
    if len(table) > 1 and np.all(np.abs(np.linalg.norm(table[:, 4:8], axis=1) - 1) < 1e-3):
        raise LogError(f"{path}: these are poses in TUM format, not relations: give them with --reference")
    deltas = np.stack([table[:, 2], table[:, 3], se2.wrap(table[:, 7])], axis=1)
    return Relations(table[:, 0], table[:, 1], deltas)
