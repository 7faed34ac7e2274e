"""Initial particles around a given start pose."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PRNGKeyArray

from jaxslam.grid.known_map import KnownMap
from jaxslam.localization.amcl import AMCL, AMCLState


def start_at(
    amcl: AMCL, key: PRNGKeyArray, pose: tuple[float, float, float], deviations: tuple[float, float]
) -> AMCLState:
    """Return particles around a known start pose (m, m, rad, world frame).

    The standard deviations are those of x and y, meters, and of the heading, radians.

    Raises:
        ValueError: the start is off the map or not in its free space.
    """
    check_start(amcl.map, pose)
    deviation, rotation = deviations
    covariance = jnp.diag(jnp.asarray([deviation, deviation, rotation], jnp.float32) ** 2)
    return jax.jit(AMCL.init)(amcl, key, jnp.asarray(pose, jnp.float32), covariance)


def check_start(map: KnownMap, pose: tuple[float, float, float]) -> None:
    """Raise `ValueError` for a start pose (m, m, rad, world frame) outside the free space of the map."""
    here = f"the start ({pose[0]:g} m, {pose[1]:g} m)"
    column, row = np.asarray(map.to_cells(jnp.asarray([pose], jnp.float32)))[0, :2]
    height, width = map.shape
    if not (0 <= column < width and 0 <= row < height):
        side = float(map.resolution)
        x, y, theta = (float(value) for value in map.origin)
        turned = f", turned by {theta:g} rad" if theta else ""
        raise ValueError(
            f"{here} is not on the map, which is {width * side:g} × {height * side:g} m from "
            f"({x:g}, {y:g}){turned}"
        )
    if not bool(map.is_free(jnp.asarray(pose, jnp.float32))):
        occupied = bool(map.occupied[int(row), int(column)])
        what = "in a wall" if occupied else "in unknown space"
        raise ValueError(f"{here} is {what}: give a pose in free space, or --global")
