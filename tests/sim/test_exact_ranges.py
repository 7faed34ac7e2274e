"""Ray casting against closed forms and a NumPy loop."""

import math

import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.sim import World, box, cast_rays, disc, hall_small, polyline
from jaxslam.sim.exact_ranges import cast_scan


def loop_cast(segments: np.ndarray, pose: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Textbook oracle in float64: solve origin + t·d = a + u·(b − a) for every ray and segment."""
    result = np.full(len(angles), np.inf)
    for i, angle in enumerate(angles):
        d = np.array([math.cos(pose[2] + angle), math.sin(pose[2] + angle)])
        for x1, y1, x2, y2 in segments:
            matrix = np.array([[d[0], x1 - x2], [d[1], y1 - y2]])
            if abs(np.linalg.det(matrix)) < 1e-12:
                continue
            t, u = np.linalg.solve(matrix, np.array([x1, y1]) - pose[:2])
            if t >= 0 and 0 <= u <= 1:
                result[i] = min(result[i], t)
    return result


@pytest.fixture(scope="module")
def room() -> World:
    return World.from_shapes("room", [box((0.0, 0.0), (4.0, 2.0))])


def test_from_the_middle_of_a_room(room: World) -> None:
    angles = jnp.array([0.0, math.pi / 2, math.pi, -math.pi / 2, math.pi / 4])
    ranges = cast_scan(room, jnp.zeros(3), angles)
    np.testing.assert_allclose(ranges, [2, 1, 2, 1, math.sqrt(2)], rtol=1e-6)


def test_moved_and_turned_pose(room: World) -> None:
    pose = jnp.array([1.0, 0.5, math.pi / 2])
    ranges = cast_scan(room, pose, jnp.array([0.0, math.pi / 2, -math.pi / 2]))
    np.testing.assert_allclose(ranges, [0.5, 3.0, 1.0], rtol=1e-6)


def test_circle_by_its_closed_form() -> None:
    world = World.from_shapes("disc", [disc((5.0, 0.0), 1.0, sides=256)])
    angle = 0.15
    ranges = cast_scan(world, jnp.zeros(3), jnp.array([angle, math.pi]))
    expected = 5 * math.cos(angle) - math.sqrt(1 - (5 * math.sin(angle)) ** 2)
    # The polygon lies up to 1 − cos(π/256) = 0.08 mm inside the circle; along this ray, which meets
    # it 49° off its normal, that is 0.12 mm.
    assert 0 <= ranges[0] - expected < 1.3e-4
    assert ranges[1] == np.inf


def test_against_a_loop_in_the_hall() -> None:
    world, tour = hall_small()
    rng = np.random.default_rng(0)
    poses = np.column_stack([tour[:8], rng.uniform(-np.pi, np.pi, 8)]).astype(np.float32)
    angles = rng.uniform(-np.pi, np.pi, 40).astype(np.float32)
    ranges = np.asarray(cast_rays(world, jnp.asarray(poses), jnp.asarray(angles)))
    segments = np.asarray(world.segments, np.float64)
    expected = np.stack([loop_cast(segments, pose.astype(np.float64), angles) for pose in poses])
    # float32 directions are off by 1e-7 rad or so: 20 m away, on a wall seen at grazing incidence
    # (tan 88° = 29), that is 6e-5 m. A ray at the very edge of a machine may fall on either side.
    differing = np.abs(ranges - expected) > 1e-4
    assert np.isfinite(ranges).all()
    assert differing.mean() < 0.005


def test_no_ray_slips_between_two_segments() -> None:
    """Rays aimed exactly at the corners of a closed polygon all hit it."""
    world = World.from_shapes("polygon", [disc((0.3, -0.2), 3.0, sides=97)])
    corners = np.asarray(world.segments[:, :2], np.float64)
    origins = np.random.default_rng(1).uniform(-1.5, 1.5, (50, 2)).astype(np.float32)
    for origin in origins:
        offset = corners - origin
        angles = jnp.asarray(np.arctan2(offset[:, 1], offset[:, 0]), jnp.float32)
        pose = jnp.asarray([*origin, 0.0], jnp.float32)
        ranges = np.asarray(cast_scan(world, pose, angles))
        np.testing.assert_allclose(ranges, np.hypot(*offset.T), rtol=1e-5)


def test_segment_seen_end_on() -> None:
    world = World.from_shapes("line", [polyline(np.array([[1.0, 0.0], [2.0, 0.0]]))])
    angle = jnp.zeros(1)
    assert cast_scan(world, jnp.zeros(3), angle)[0] == 1.0
    assert cast_scan(world, jnp.array([1.5, 0.0, 0.0]), angle)[0] == 0.0
    assert cast_scan(world, jnp.array([3.0, 0.0, 0.0]), angle)[0] == np.inf
    assert cast_scan(world, jnp.array([0.0, 0.1, 0.0]), angle)[0] == np.inf
