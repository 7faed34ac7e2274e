"""ICP recovers known offsets in a simulated room; its parts against NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.lidar import ScanPoints
from jaxslam.matching import ICP, rigid_fit
from tests.builders import field_of, points_of, room_cells, room_ranges

RESOLUTION = 0.05
ANGLES = np.deg2rad(np.arange(-90.0, 90.0))
POSE = np.array([0.4, -0.3, 0.2])
# Half sides of a room, meters, and a box in it: lower and upper corner.
ROOM, BOX = np.array([3.0, 2.0]), np.array([[1.2, 0.4], [1.9, 1.1]])

match = jax.jit(ICP.match)
fit = jax.jit(rigid_fit)


def ends_of(pose, noise=0.0, valid=None) -> ScanPoints:
    error = noise * np.random.default_rng(1).standard_normal(len(ANGLES))
    return points_of(room_ranges(pose, ANGLES, ROOM, BOX) + error, ANGLES, valid)


@pytest.fixture(scope="module")
def field():
    """The walls in 5 cm cells whose centers lie on them."""
    corner = np.array([-4.0, -3.0]) - RESOLUTION / 2
    occupied = room_cells((121, 161), corner, RESOLUTION, (-ROOM, ROOM), BOX)
    return field_of(occupied, corner, RESOLUTION)


@pytest.mark.parametrize("seed", range(8))
def test_offsets_up_to_30_cm_and_10_degrees_are_recovered(field, seed):
    random = np.random.default_rng(seed)
    direction, turn = random.uniform(0, 2 * np.pi), random.choice([-1, 1]) * np.deg2rad(10)
    start = POSE + np.array([0.3 * np.cos(direction), 0.3 * np.sin(direction), turn])
    # Twice the default iterations: a point-to-point step along a wall is short.
    found = match(ICP(num_iterations=40), field, ends_of(POSE, noise=0.01), jnp.asarray(start, jnp.float32))
    error = np.asarray(found.pose, float) - POSE
    assert np.hypot(*error[:2]) < 0.01
    assert abs(error[2]) < np.deg2rad(0.3)
    assert found.error < 0.03


@pytest.mark.parametrize("seed", range(5))
def test_the_closed_form_is_the_singular_value_decomposition(seed):
    random = np.random.default_rng(seed)
    points, weights = random.normal(size=(30, 2)), random.uniform(0, 1, 30)
    partners = (
        points @ np.array([[0.6, -0.8], [0.8, 0.6]]).T + [1.0, -2.0] + 0.1 * random.normal(size=(30, 2))
    )
    total = weights.sum()
    center, target = weights @ points / total, weights @ partners / total
    u, _, vt = np.linalg.svd((points - center).T @ np.diag(weights) @ (partners - target))
    turn = vt.T @ np.diag([1.0, np.linalg.det(vt.T @ u.T)]) @ u.T
    expected = [*(target - turn @ center), np.arctan2(turn[1, 0], turn[0, 0])]
    arguments = (jnp.asarray(a, jnp.float32) for a in (points, partners, weights))
    np.testing.assert_allclose(fit(*arguments), expected, atol=1e-5)


def test_without_weight_nothing_moves():
    ones = jnp.ones((4, 2), jnp.float32)
    np.testing.assert_array_equal(fit(ones, 0.0 * ones, jnp.zeros(4, jnp.float32)), np.zeros(3))


@pytest.mark.parametrize("seed", range(3))
def test_outliers_are_trimmed(field, seed):
    ends = ends_of(POSE)
    wrong = np.random.default_rng(seed).choice(len(ANGLES), 20, replace=False)
    ends = ScanPoints(ends.points.at[wrong].mul(0.6), ends.valid, ends.normals)
    found = match(
        ICP(num_iterations=40), field, ends, jnp.asarray(POSE + np.array([0.05, 0.05, 0.03]), jnp.float32)
    )
    error = np.asarray(found.pose, float) - POSE
    assert np.hypot(*error[:2]) < 0.02
    assert abs(error[2]) < np.deg2rad(0.6)


def test_nothing_to_see_leaves_the_pose():
    empty = field_of(np.zeros((40, 40), bool), resolution=RESOLUTION)
    start = jnp.asarray([1.0, 1.0, 0.3], jnp.float32)
    for field_, ends in (
        (empty, ends_of(POSE)),
        (empty, ends_of(POSE, valid=np.zeros(len(ANGLES), bool))),
    ):
        found = match(ICP(), field_, ends, start)
        np.testing.assert_allclose(found.pose, start, atol=1e-6)
        assert np.isinf(found.error)
        assert not found.converged
        assert np.isfinite(found.covariance).all()


def test_the_covariance_is_long_where_the_walls_say_nothing(field):
    straight = np.abs(np.rad2deg(ANGLES)) > 75
    ends = ends_of(np.array([0.0, 0.0, 0.0]), noise=0.01, valid=straight)
    found = match(ICP(), field, ends, jnp.zeros(3, jnp.float32))
    covariance = np.asarray(found.covariance)
    assert np.linalg.eigvalsh(covariance).min() > 0
    # Only the walls to both sides are seen: along them, x, a meter is possible.
    assert covariance[0, 0] > 100 * covariance[1, 1]
