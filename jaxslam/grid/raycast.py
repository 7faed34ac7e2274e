"""Expected ranges, by casting beams into a distance field."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxslam.grid.field import DistanceField

_NUDGE = 1e-3
"""Cells by which a step passes a cell's side: more than float32 rounding on maps of 8000 cells."""
_Beams = tuple[Float[Array, "B"], Bool[Array, "B"], Bool[Array, "B"], Int[Array, ""]]
"""Cells travelled, whether the beam has hit, whether it has ended, and the number of steps."""


def cast(
    field: DistanceField,
    pose_lidar: Float[Array, "3"],
    angles: Float[Array, "B"],
    max_range: float | Float[Array, ""],
) -> Float[Array, "B"]:
    """Return the distance from a lidar to where each beam enters the first occupied cell.

    The method is sphere tracing. Far from obstacles, a step covers the distance that the field guarantees to
    be free. Near obstacles, a step goes to the next cell along the beam, so no cell is skipped, except at
    corners cut by less than a thousandth of a cell. All beams step together until the last has ended, at most
    once per cell that a line can cross.

    Args:
        field: of the map. Its outermost `radius` columns on either side are not read (`DistanceField`).
        pose_lidar: `[3]` pose of the lidar in the world: m, m, rad.
        angles: `[B]` directions in the lidar frame, radians.
        max_range: meters.

    Returns:
        `[B]` meters; 0 if the lidar is in an occupied cell, `max_range` if nothing is hit in range and field.

    Example:
        With 1 m cells, the lidar in the center of a cell and the third cell to its right occupied, the range
        is 2.5 at angle 0.
    """
    scale = 1.0 / field.resolution
    heading = pose_lidar[2] + angles
    direction = jnp.stack([jnp.cos(heading), jnp.sin(heading)], axis=-1)
    forward = direction > 0
    # A beam along one axis never crosses the cell sides of the other; 1e-9 makes that step very long.
    speed = jnp.maximum(jnp.abs(direction), 1e-9)
    first = (pose_lidar[:2] - field.origin) * scale
    reach = max_range * scale
    size = jnp.asarray([field.width, field.height], jnp.float32)

    def cells_at(travelled: Float[Array, "B"]) -> Float[Array, "B 2"]:
        return first[None, :] + travelled[:, None] * direction

    def unfinished(carry: _Beams) -> Bool[Array, ""]:
        _, _, done, trips = carry
        return ~jnp.all(done) & (trips <= field.height + field.width)

    def advance(carry: _Beams) -> _Beams:
        travelled, hit, done, trips = carry
        cells = cells_at(travelled)
        corner = jnp.floor(cells)
        # Read at the centers of the cells, safe from rounding.
        squared = field.squared_distance(field.centers(corner)) / field.resolution**2
        to_side = jnp.where(forward, corner + 1.0 - cells, cells - corner)
        to_next_cell = jnp.min((to_side + _NUDGE) / speed, axis=-1)
        # The distance is between cell centers: up to half a diagonal lies inside each of the two cells.
        step = jnp.maximum(jnp.sqrt(squared) - np.float32(np.sqrt(2.0)), to_next_cell)
        off_field = jnp.any((cells < 0) | (cells >= size[None, :]), axis=-1)
        hit = hit | (~done & (squared == 0))
        done = done | hit | off_field | (travelled >= reach)
        return jnp.where(done, travelled, travelled + step), hit, done, trips + 1

    none = jnp.zeros(angles.shape, bool)
    start = (jnp.zeros_like(angles), none, none, jnp.zeros((), jnp.int32))
    travelled, hit, _, _ = jax.lax.while_loop(unfinished, advance, start)
    # The last step may have ended inside the cell: go back to the later of the two sides crossed on entry.
    corner = jnp.floor(cells_at(travelled))
    to_entry = jnp.where(forward, corner - first[None, :], first[None, :] - corner - 1.0) / speed
    entered = jnp.maximum(jnp.max(to_entry, axis=-1), 0.0)
    return jnp.where(hit, jnp.minimum(entered * field.resolution, max_range), max_range)
