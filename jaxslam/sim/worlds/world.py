"""Worlds made of straight line segments, and the shapes to build them from.

Builders run on the host in NumPy float64; a `World` holds the result as device arrays. A builder of a world
is a function that combines shapes and returns `World.from_shapes(name, shapes)`.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float64, PRNGKeyArray


class World(eqx.Module):
    """Walls and obstacles as line segments in the world frame.

    Attributes:
        segments: `[S, 4]` end points x1, y1, x2, y2 in meters. Segments that share a corner share
            its coordinates exactly, which makes ray casting watertight there.
        name: name of the world (static).
    """

    segments: Float[Array, "*batch S 4"]
    name: str = eqx.field(static=True)

    @classmethod
    def from_shapes(cls, name: str, shapes: list[Float64[np.ndarray, "_ 4"]]) -> "World":
        """Combine shapes `[·, 4]` (meters) to one world.

        Raises:
            ValueError: if there is no segment, a segment is not finite, or a segment has no length.
        """
        segments = np.concatenate([np.zeros((0, 4)), *shapes])
        if len(segments) == 0:
            raise ValueError(f"world {name!r} has no segment: give at least one shape")
        if not np.isfinite(segments).all():
            raise ValueError(f"world {name!r} has a segment that is not finite: check its shapes")
        # Compare in float32, the precision on the device.
        rounded = segments.astype(np.float32)
        empty = (rounded[:, :2] == rounded[:, 2:]).all(axis=1)
        if empty.any():
            raise ValueError(
                f"world {name!r} has {int(empty.sum())} segments without length, the first at "
                f"{segments[empty][0, :2].tolist()}: leave them out"
            )
        return cls(segments=jnp.asarray(segments, jnp.float32), name=name)

    def bounds(self) -> tuple[Float64[np.ndarray, "2"], Float64[np.ndarray, "2"]]:
        """Return the lower left and upper right corner of the box around all segments, meters (host)."""
        points = np.asarray(self.segments, np.float64).reshape(-1, 2)
        return points.min(axis=0), points.max(axis=0)


Site = tuple[World, Float64[np.ndarray, "W 2"]]
"""A world and the way-points `[W, 2]` of a closed tour through it, meters."""


def host_generator(key: PRNGKeyArray) -> np.random.Generator:
    """Return a NumPy generator that is seeded with a PRNG key."""
    return np.random.default_rng(np.asarray(jax.random.key_data(key)))


def polyline(points: Float64[np.ndarray, "P 2"], *, closed: bool = False) -> Float64[np.ndarray, "_ 4"]:
    """Return the segments `[P − 1, 4]` from point to point, or `[P, 4]` of the closed outline."""
    end = np.roll(points, -1, axis=0)
    segments = np.concatenate([points, end], axis=1)
    return segments if closed else segments[:-1]


def place(
    points: Float64[np.ndarray, "P 2"], center: tuple[float, float], angle: float
) -> Float64[np.ndarray, "P 2"]:
    """Rotate points by `angle` radians about the origin, then move the origin to `center`."""
    cos, sin = np.cos(angle), np.sin(angle)
    return points @ np.array([[cos, sin], [-sin, cos]]) + np.asarray(center)


def box(
    center: tuple[float, float], size: tuple[float, float], *, angle: float = 0.0, chamfer: float = 0.0
) -> Float64[np.ndarray, "_ 4"]:
    """Return a machine as a rectangle, `[4, 4]`, or with chamfered corners, `[8, 4]`.

    Args:
        center: x, y of the center, meters.
        size: lengths of the sides, meters.
        angle: counter-clockwise rotation, radians.
        chamfer: length cut from each side at a corner, meters.
    """
    half = np.asarray(size) / 2
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * half
    if chamfer > 0:
        neighbors = np.stack([np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0)], axis=1)
        toward = np.sign(neighbors - corners[:, None])
        corners = (corners[:, None] + chamfer * toward).reshape(-1, 2)
    return polyline(place(corners, center, angle), closed=True)


def disc(center: tuple[float, float], radius: float, *, sides: int = 16) -> Float64[np.ndarray, "_ 4"]:
    """Return a tank or pillar as a regular polygon `[sides, 4]` whose corners lie on the circle."""
    angles = 2 * np.pi * np.arange(sides) / sides
    circle = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return polyline(circle + np.asarray(center), closed=True)


def walls(
    size: tuple[float, float], depth: float, niches: list[list[tuple[float, float]]]
) -> Float64[np.ndarray, "_ 4"]:
    """Return the wall around a hall, set back by niches (doors, windows) that reach the outer bounds.

    Args:
        size: outer bounds from the origin, meters.
        depth: distance of the wall from the bounds, meters.
        niches: niches of the lower, right, upper and left wall as (start, width), meters, measured
            counter-clockwise from the corner where the wall begins.
    """
    width, height = size
    corners = np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]])
    directions = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    points = []
    for index, (corner, side) in enumerate(zip(corners, niches, strict=True)):
        outline = [(depth, depth)]
        for start, opening in side:
            end = start + opening
            outline += [(start, depth), (start, 0.0), (end, 0.0), (end, depth)]
        along, inwards = directions[index], directions[(index + 1) % 4]
        points.append(corner + np.array(outline) @ np.stack([along, inwards]))
    return polyline(np.concatenate(points), closed=True)


def leg_clearances(
    segments: Float64[np.ndarray, "S 4"], waypoints: Float64[np.ndarray, "W 2"]
) -> Float64[np.ndarray, "W"]:
    """Return the distance of each leg of a closed tour to the nearest segment, meters; 0 if they cross.

    Leg `i` runs from way-point `i` to the next one, the last leg back to the first way-point.
    """
    start, end = waypoints[:, None], np.roll(waypoints, -1, axis=0)[:, None]
    first, second = segments[None, :, :2], segments[None, :, 2:]
    # Two segments that do not cross are nearest at an end point of one of them.
    distance_first, side_first = _distance_and_side(first, start, end)
    distance_second, side_second = _distance_and_side(second, start, end)
    distance_start, side_start = _distance_and_side(start, first, second)
    distance_end, side_end = _distance_and_side(end, first, second)
    crossing = (side_first * side_second < 0) & (side_start * side_end < 0)
    distances = np.minimum.reduce([distance_first, distance_second, distance_start, distance_end])
    return np.where(crossing, 0.0, distances).min(axis=1)


def _distance_and_side(
    point: Float64[np.ndarray, "_ _ 2"],
    start: Float64[np.ndarray, "_ _ 2"],
    end: Float64[np.ndarray, "_ _ 2"],
) -> tuple[Float64[np.ndarray, "_ _"], Float64[np.ndarray, "_ _"]]:
    """Return the distance of points to segments, and a number that is positive to the left of a segment."""
    along, offset = end - start, point - start
    fraction = (offset * along).sum(axis=-1) / (along**2).sum(axis=-1)
    nearest = start + np.clip(fraction, 0.0, 1.0)[..., None] * along
    side = along[..., 0] * offset[..., 1] - along[..., 1] * offset[..., 0]
    return np.linalg.norm(point - nearest, axis=-1), side
