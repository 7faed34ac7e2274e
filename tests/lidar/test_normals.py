"""Normals of walls, from the end points alone."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.lidar import surface_normals

normals_of = jax.jit(surface_normals)


def found(points, valid=None):
    points = jnp.asarray(points, jnp.float32)
    valid = jnp.ones(len(points), bool) if valid is None else jnp.asarray(valid)
    return np.asarray(normals_of(points, valid), float)


def wall(angle, spacing=0.05, count=9, offset=2.0):
    """Points along a line at `angle`, `offset` from the origin."""
    along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    return offset * across + (np.arange(count) - count // 2)[:, None] * spacing * along


@pytest.mark.parametrize("angle", [0.0, 0.4, 1.2, np.pi / 2, -0.7])
@pytest.mark.parametrize("spacing", [0.01, 0.05, 0.8])
def test_across_a_straight_wall(angle, spacing):
    normals = found(wall(angle, spacing))
    inner = normals[1:-1]
    np.testing.assert_allclose(np.linalg.norm(inner, axis=1), 1.0, atol=1e-5)
    np.testing.assert_allclose(inner @ [np.cos(angle), np.sin(angle)], 0.0, atol=1e-3)


def test_noise_turns_them_little():
    points = wall(0.3, 0.04, 60) + np.random.default_rng(0).normal(0.0, 0.005, (60, 2))
    normals = found(points)[4:-4]
    assert np.degrees(np.arcsin(np.abs(normals @ [np.cos(0.3), np.sin(0.3)]))).max() < 8


def test_none_at_a_corner_and_none_alone():
    side = np.arange(5)[:, None] * 0.05
    corner = np.concatenate([side[::-1] * [1.0, 0.0], side[1:] * [0.0, 1.0]])
    assert not found(corner)[4].any()
    assert not found([[0.0, 0.0], [9.0, 0.0], [0.0, 9.0]]).any()


def test_a_jump_in_depth_is_no_wall():
    near, far = wall(0.0, 0.05, 5, offset=1.0), wall(0.0, 0.1, 5, offset=3.0) + np.array([0.5, 0.0])
    normals = found(np.concatenate([near, far]))
    np.testing.assert_allclose(np.abs(normals @ [0.0, 1.0]), 1.0, atol=1e-3)


def test_beams_without_return_neither_have_nor_make_one():
    valid = np.arange(9) != 4
    points = np.where(valid[:, None], wall(0.5), 0.0)
    normals = found(points, valid)
    assert not normals[4].any()
    np.testing.assert_allclose(normals[[2, 3, 5, 6]] @ [np.cos(0.5), np.sin(0.5)], 0.0, atol=1e-3)
    assert not found(np.zeros((9, 2)), np.zeros(9, bool)).any()


def test_the_first_and_the_last_beam_are_no_neighbors():
    """A scan of 180° starts and ends on different walls."""
    points = wall(0.0, 0.05, 4)
    assert np.isfinite(found(points)).all()
    np.testing.assert_allclose(np.abs(found(points)[:, 1]), 1.0, atol=1e-3)
