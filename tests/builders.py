"""Scans, odometry increments, fields and small maps that many tests build."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxslam.core.types import LidarScan, OdometryIncrement, StepInputs
from jaxslam.grid import GridSpec, field_of_map
from jaxslam.io import OccupancyMap
from jaxslam.lidar import ScanPoints, surface_normals
from jaxslam.sim import hall_small
from jaxslam.sim.rasterize import rasterize

_prepare = jax.jit(field_of_map, static_argnums=3)


def scan_of(ranges, valid=None, *, angle_min=0.0, increment=None, mounting=(0.0, 0.0, 0.0)) -> LidarScan:
    """Return a scan, or a stack of scans, of the ranges `[..., B]` in meters.

    A range above 0 is valid unless `valid` says otherwise. Without an increment the beams fill a whole turn.
    """
    ranges = jnp.asarray(ranges, jnp.float32)
    stack, num_beams = ranges.shape[:-1], ranges.shape[-1]
    return LidarScan(
        ranges=ranges,
        valid=ranges > 0 if valid is None else jnp.asarray(valid, bool),
        angle_min=jnp.full(stack, angle_min, jnp.float32),
        angle_increment=jnp.full(
            stack, 2 * np.pi / num_beams if increment is None else increment, jnp.float32
        ),
        pose_base_lidar=jnp.broadcast_to(jnp.asarray(mounting, jnp.float32), (*stack, 3)),
    )


def odometry_of(delta, covariance=None, dt=1.0) -> OdometryIncrement:
    """Return an increment, or a stack of increments, `[..., 3]`; without a covariance it is zero."""
    delta = jnp.asarray(delta, jnp.float32)
    covariance = jnp.zeros((3, 3)) if covariance is None else jnp.asarray(covariance, jnp.float32)
    stack = delta.shape[:-1]
    return OdometryIncrement(
        delta, jnp.broadcast_to(covariance, (*stack, 3, 3)), jnp.full(stack, dt, jnp.float32)
    )


def inputs_of(delta, ranges, valid=None, *, dt=0.2, **geometry) -> StepInputs:
    """Return a step, or a stack of steps: odometry without covariance, and a scan (see `scan_of`)."""
    return StepInputs(odometry_of(delta, dt=dt), scan_of(ranges, valid, **geometry))


def points_of(ranges, angles, valid=None) -> ScanPoints:
    """Return the end points of beams at `angles` from the origin, with the normals of the walls they hit."""
    valid = np.ones(len(ranges), bool) if valid is None else valid
    points = (ranges * valid)[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    points, valid = jnp.asarray(points, jnp.float32), jnp.asarray(valid)
    return ScanPoints(points, valid, surface_normals(points, valid))


def field_of(occupied, origin=(0.0, 0.0), resolution=0.1, radius=6):
    """Return the field of a map of occupied cells `[H, W]` whose lower-left corner is at `origin`."""
    origin = jnp.asarray(origin, jnp.float32)
    return _prepare(jnp.asarray(occupied), origin, jnp.float32(resolution), radius)


def room_ranges(pose, angles, half_sides, box=None):
    """Return the exact ranges `[B]` of beams at `angles` from a pose inside a rectangular room, in NumPy.

    The room lies around the origin. `box` is the lower and the upper corner of an obstacle in it.
    """
    direction = np.stack([np.cos(pose[2] + angles), np.sin(pose[2] + angles)], axis=-1)
    direction = np.where(np.abs(direction) < 1e-9, 1e-9, direction)
    to_walls = ((half_sides - np.sign(direction) * pose[:2]) / np.abs(direction)).min(axis=1)
    if box is None:
        return to_walls
    sides = np.sort(np.stack([(corner - pose[:2]) / direction for corner in box]), axis=0)
    enter, leave = sides[0].max(axis=1), sides[1].min(axis=1)
    return np.where((enter < leave) & (enter > 0), np.minimum(enter, to_walls), to_walls)


def room_cells(shape, corner, resolution, *outlines):
    """Return the cells `[H, W]` of a map with its lower-left at `corner`, the sides of rectangles occupied.

    An outline is the lower and the upper corner of a rectangle; both are the center of a cell.
    """
    occupied = np.zeros(shape, bool)
    for outline in outlines:
        cells = np.rint((np.asarray(outline) - corner) / resolution - 0.5).astype(int)
        (left, bottom), (right, top) = cells
        occupied[[bottom, top], left : right + 1] = True
        occupied[bottom : top + 1, [left, right]] = True
    return occupied


def hall_map(resolution=0.05):
    """Return the small hall as a map, its world and its waypoints; all but the walls is free inside."""
    world, waypoints = hall_small()
    spec = GridSpec.covering(np.array([-0.5, -0.5]), np.array([18.5, 15.5]), resolution)
    occupied = np.asarray(rasterize(world, spec))
    free = np.zeros_like(occupied)
    side = round(0.5 / resolution)
    free[side:-side, side:-side] = ~occupied[side:-side, side:-side]
    return OccupancyMap(occupied, free, resolution, np.array([-0.5, -0.5, 0.0])), world, waypoints


def carmen_log(stamps, ranges, poses, *, mounting=0.0):
    """Return the text of a CARMEN log: ranges `[S, B]`, where not finite is no return, and odometry `[S, 3]`.

    The lidar is mounted `mounting` meters ahead of the base.
    """
    lines = [f"PARAM robot_frontlaser_offset {mounting}"]
    for stamp, readings, (x, y, theta) in zip(stamps, ranges, poses, strict=True):
        beams = " ".join(f"{reading:.3f}" for reading in np.where(np.isfinite(readings), readings, 81.83))
        lidar = f"{x + mounting * np.cos(theta):.6f} {y + mounting * np.sin(theta):.6f} {theta:.6f}"
        base = f"{x:.6f} {y:.6f} {theta:.6f}"
        lines.append(f"FLASER {len(readings)} {beams} {lidar} {base} {stamp:.6f} host {stamp:.6f}")
    return "\n".join(lines) + "\n"


def forward_half(ranges):
    """Return the 181 beams of the forward half circle of full turns `[S, 360]`."""
    return np.concatenate([ranges[:, 270:], ranges[:, :91]], axis=1)


def room(*, origin=(0.0, 0.0, 0.0)):
    """Return a map of 4 × 3 m in cells of 0.5 m: a wall of one cell all round, and one at the top right."""
    occupied = np.ones((6, 8), bool)
    occupied[1:5, 1:7] = False
    occupied[4, 6] = True
    return OccupancyMap(occupied, ~occupied, 0.5, np.array(origin, float))
