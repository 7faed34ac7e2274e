"""SE(2) against 3 × 3 homogeneous matrices in float64, and the group's own laws."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.core import se2

PI = float(np.float32(np.pi))
BATCHES = [(), (2, 3), (0,)]
# Rounding of a float32 sum of positions of up to 20 m and angles of up to 2π.
ATOL = 1e-5


def poses(kind: str, batch: tuple[int, ...], seed: int) -> jnp.ndarray:
    rng = np.random.default_rng(seed)
    position = rng.uniform(-10.0, 10.0, (*batch, 2))
    heading = rng.uniform(-np.pi, np.pi, (*batch, 1))
    if kind == "near identity":
        position, heading = 1e-6 * position, 1e-6 * heading
    if kind == "near pi":
        sign = np.where(heading < 0.0, -1.0, 1.0)
        heading = sign * (np.pi - 1e-6 * np.abs(heading))
    return jnp.asarray(np.concatenate([position, heading], axis=-1), jnp.float32)


def matrix(pose) -> np.ndarray:
    x, y, theta = np.moveaxis(np.asarray(pose, np.float64), -1, 0)
    cos, sin, zero, one = np.cos(theta), np.sin(theta), np.zeros_like(x), np.ones_like(x)
    rows = [[cos, -sin, x], [sin, cos, y], [zero, zero, one]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def assert_same_pose(found, expected):
    np.testing.assert_allclose(matrix(found), matrix(expected), atol=ATOL)
    assert (np.asarray(found)[..., 2] >= -PI).all()
    assert (np.asarray(found)[..., 2] < PI).all()


cases = pytest.mark.parametrize(
    ("kind", "batch"),
    [(kind, batch) for kind in ("random", "near identity", "near pi") for batch in BATCHES],
)


@cases
def test_compose_and_inverse_are_the_matrix_product_and_inverse(kind, batch):
    a, b = poses(kind, batch, 0), poses(kind, batch, 1)
    composed, inverse = se2.compose(a, b), se2.inverse(a)
    assert composed.shape == inverse.shape == (*batch, 3)
    assert composed.dtype == inverse.dtype == jnp.float32
    assert not composed.weak_type
    np.testing.assert_allclose(matrix(composed), matrix(a) @ matrix(b), atol=ATOL)
    np.testing.assert_allclose(matrix(inverse), np.linalg.inv(matrix(a)), atol=ATOL)


@cases
def test_group_laws(kind, batch):
    a, b, c = (poses(kind, batch, seed) for seed in range(3))
    identity = jnp.zeros((*batch, 3), jnp.float32)
    assert_same_pose(se2.compose(a, se2.inverse(a)), identity)
    assert_same_pose(se2.compose(se2.inverse(a), a), identity)
    assert_same_pose(se2.compose(a, identity), a)
    assert_same_pose(se2.compose(identity, a), a)
    assert_same_pose(se2.inverse(se2.inverse(a)), a)
    assert_same_pose(
        se2.compose(se2.compose(a, b), c),
        se2.compose(a, se2.compose(b, c)),
    )


@cases
def test_relative_undoes_compose(kind, batch):
    a, b = poses(kind, batch, 0), poses(kind, batch, 1)
    assert_same_pose(se2.relative(a, se2.compose(a, b)), b)
    assert_same_pose(se2.compose(a, se2.relative(a, b)), b)
    assert_same_pose(se2.relative(a, b), se2.compose(se2.inverse(a), b))
    assert_same_pose(se2.relative(a, a), jnp.zeros_like(a))


def test_a_small_relative_motion_far_from_the_origin_keeps_its_digits():
    # 1 mm of motion 100 m out: float32 positions are 7.6e-6 m apart there.
    a = jnp.array([100.0, -100.0, 0.7], jnp.float32)
    step = jnp.array([1e-3, 0.0, 1e-3], jnp.float32)
    np.testing.assert_allclose(se2.relative(a, se2.compose(a, step)), step, atol=1.6e-5)


@pytest.mark.parametrize("kind", ["random", "near identity", "near pi"])
@pytest.mark.parametrize("batch", BATCHES)
def test_apply_moves_points_as_the_matrix_does(kind, batch):
    pose = poses(kind, (), 3)
    points = jnp.asarray(np.random.default_rng(4).uniform(-5.0, 5.0, (*batch, 2)), jnp.float32)
    moved = se2.apply(pose, points)
    homogeneous = np.concatenate([np.asarray(points), np.ones((*batch, 1))], axis=-1)
    expected = np.einsum("ij,...j->...i", matrix(pose), homogeneous)[..., :2]
    assert moved.shape == points.shape
    np.testing.assert_allclose(moved, expected, atol=ATOL)


def test_apply_is_compose_on_positions():
    a, b = poses("random", (), 5), poses("random", (), 6)
    np.testing.assert_allclose(se2.apply(a, b[:2]), se2.compose(a, b)[:2], atol=ATOL)


def test_rotate_by_hand():
    quarter = jnp.array(np.pi / 2, jnp.float32)
    np.testing.assert_allclose(se2.rotate(quarter, jnp.array([2.0, 1.0])), [-1.0, 2.0], atol=1e-6)


def test_worked_examples_of_the_docstrings():
    composed = se2.compose(
        jnp.array([1.0, 0.0, np.pi / 2], jnp.float32), jnp.array([2.0, 0.0, 0.0], jnp.float32)
    )
    np.testing.assert_allclose(composed, [1.0, 2.0, np.pi / 2], atol=1e-6)
    angles = se2.wrap(jnp.array([1.5 * np.pi, np.pi], jnp.float32))
    np.testing.assert_allclose(angles, [-np.pi / 2, -np.pi], atol=1e-6)


def test_wrap_stays_in_the_half_open_interval_and_keeps_the_direction():
    rng = np.random.default_rng(0)
    corners = np.float32(np.pi) * np.arange(-9, 10)
    corners = np.concatenate([np.nextafter(corners, s, dtype=np.float32) for s in (-99, 0, 99)])
    tiny = np.array([0.0, -0.0, 1e-20, -1e-20, 1e-7, -1e-7, 1e-38, -1e-38])
    angles = np.concatenate([rng.uniform(-30.0, 30.0, 1000), corners, tiny]).astype(np.float32)
    wrapped = np.asarray(se2.wrap(jnp.asarray(angles)))
    assert wrapped.dtype == np.float32
    assert (wrapped >= -PI).all()
    assert (wrapped < PI).all()
    # Angles of up to 30 are 1.9e-6 apart in float32, and the sum with π rounds once more.
    turn = np.exp(1j * wrapped.astype(np.float64)) - np.exp(1j * angles.astype(np.float64))
    np.testing.assert_allclose(np.abs(turn), 0.0, atol=6e-6)


def test_wrap_is_the_identity_inside_and_idempotent():
    angles = jnp.asarray(np.linspace(-3.14159, 3.14159, 1001), jnp.float32)
    # The sum with π rounds to 4.8e-7 at most.
    np.testing.assert_allclose(se2.wrap(angles), angles, atol=5e-7)
    far = jnp.asarray(np.linspace(-20.0, 20.0, 1001), jnp.float32)
    np.testing.assert_allclose(se2.wrap(se2.wrap(far)), se2.wrap(far), atol=5e-7)


@pytest.mark.parametrize("angle", [0.0, 1e-7, 3.0, -3.0, 4.0, -9.0])
def test_wrap_has_slope_one(angle):
    assert float(jax.grad(se2.wrap)(jnp.float32(angle))) == 1.0


@pytest.mark.parametrize("function", [se2.compose, se2.relative])
def test_vmap_jit_and_broadcast_agree(function):
    a, b = poses("random", (5,), 0), poses("random", (5,), 1)
    batched = function(a, b)
    np.testing.assert_allclose(jax.vmap(function)(a, b), batched, atol=ATOL)
    np.testing.assert_allclose(jax.jit(function)(a, b), batched, atol=ATOL)


def test_gradients_are_finite_at_the_identity():
    zero = jnp.zeros(3, jnp.float32)
    jacobian = jax.jacfwd(se2.compose, argnums=(0, 1))(zero, zero)
    for block in jacobian:
        np.testing.assert_allclose(block, np.eye(3), atol=1e-7)
