"""What every sensor model must do, over a registry of all of them."""

import functools

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxslam.sensor
from jaxslam.core import se2
from jaxslam.core.types import LidarScan
from jaxslam.sensor import AbstractSensorModel, Beam, Endpoint, LikelihoodField, Nav2Field
from tests.builders import field_of, scan_of
from tests.checks import assert_strongly_typed, jit_once

MODELS = {
    "likelihood field": LikelihoodField(max_beams=20),
    "endpoint": Endpoint(max_beams=20),
    "beam": Beam(max_range=8.0, max_beams=20),
    "nav2 field": Nav2Field(max_range=8.0, max_beams=20),
}
every_model = pytest.mark.parametrize("model", MODELS.values(), ids=MODELS.keys())
NUM_BEAMS, RESOLUTION = 32, 0.1
MOUNTING = np.array([0.2, -0.1, 0.4])
# Center of a room of 4 × 3 m with a pillar, and poses around the true one.
TRUE_POSE = jnp.asarray([0.3, -0.2, 0.5], jnp.float32)


@functools.cache
def room():
    """Occupied cells `[36, 46]`, lower-left corner at (−2.3, −1.8)."""
    occupied = np.zeros((36, 46), bool)
    occupied[[2, -3], 2:-2] = occupied[2:-2, [2, -3]] = True
    occupied[25:28, 30:34] = True
    return occupied


def walk_out(occupied, start, angle):
    """Range of a ray in the room, by steps of a millimeter."""
    along = np.arange(0.0, 6.0, 1e-3)
    points = start + along[:, None] * np.array([np.cos(angle), np.sin(angle)])
    cells = np.floor((points - [-2.3, -1.8]) / RESOLUTION).astype(int)
    return along[np.argmax(occupied[cells[:, 1].clip(0, 35), cells[:, 0].clip(0, 45)])] + 0.5 * RESOLUTION


@functools.cache
def scan() -> LidarScan:
    lidar = np.asarray(se2.compose(TRUE_POSE, jnp.asarray(MOUNTING, jnp.float32)), np.float64)
    angles = -np.pi + 2 * np.pi / NUM_BEAMS * np.arange(NUM_BEAMS)
    ranges = [walk_out(room(), lidar[:2], lidar[2] + angle) for angle in angles]
    valid = np.arange(NUM_BEAMS) % 7 != 3
    return scan_of(np.where(valid, ranges, 0.0), valid, angle_min=-np.pi, mounting=MOUNTING)


@functools.cache
def field():
    return field_of(room(), (-2.3, -1.8), RESOLUTION)


@jax.jit
def log_prob(model, field, scan, pose):
    return model.log_prob(field, scan, pose)


def test_every_model_is_registered():
    public = {getattr(jaxslam.sensor, name) for name in jaxslam.sensor.__all__}
    models = {p for p in public if isinstance(p, type) and issubclass(p, AbstractSensorModel)}
    assert models - {AbstractSensorModel} == {type(model) for model in MODELS.values()}
    assert models - {AbstractSensorModel} == set(AbstractSensorModel.__subclasses__())


@every_model
def test_the_true_pose_is_the_likeliest(model):
    at_truth = float(log_prob(model, field(), scan(), TRUE_POSE))
    for offset in ([0.3, 0, 0], [-0.3, 0, 0], [0, 0.3, 0], [0, -0.3, 0], [0, 0, 0.3], [0, 0, -0.3]):
        assert (
            float(log_prob(model, field(), scan(), TRUE_POSE + jnp.asarray(offset, jnp.float32))) < at_truth
        )


@every_model
def test_jit_and_vmap_change_nothing(model):
    poses = TRUE_POSE[None] + 0.1 * jax.random.normal(jax.random.key(0), (3, 3), jnp.float32)
    one_by_one = [log_prob(model, field(), scan(), pose) for pose in poses]
    together = jax.jit(jax.vmap(model.log_prob, (None, None, 0)))(field(), scan(), poses)
    # An end point on the edge of a cell may round to either side: one beam of twenty, of weight 0.05.
    np.testing.assert_allclose(together, one_by_one, atol=1e-4)
    np.testing.assert_allclose(model.log_prob(field(), scan(), poses[0]), one_by_one[0], atol=1e-4)


@every_model
def test_output_is_a_strongly_typed_scalar(model):
    output = jax.eval_shape(model.log_prob, field(), scan(), TRUE_POSE)
    chex.assert_trees_all_equal_shapes_and_dtypes(output, jax.ShapeDtypeStruct((), jnp.float32))
    assert_strongly_typed(output)


@every_model
def test_new_parameter_values_do_not_recompile(model):
    run = jit_once(lambda model, pose: model.log_prob(field(), scan(), pose))
    first = run(model, TRUE_POSE + 0.1)
    again = run(jax.tree.map(lambda value: value * 1.5, model), TRUE_POSE + 0.1)
    assert float(first) != float(again)


@every_model
def test_only_valid_beams_count(model):
    shortened = LidarScan(
        jnp.where(scan().valid, scan().ranges, 1.234),
        scan().valid,
        scan().angle_min,
        scan().angle_increment,
        scan().pose_base_lidar,
    )
    pose = TRUE_POSE + 0.05
    assert float(log_prob(model, field(), shortened, pose)) == float(log_prob(model, field(), scan(), pose))
    blind = LidarScan(
        jnp.zeros(NUM_BEAMS), jnp.zeros(NUM_BEAMS, bool), *jax.tree.leaves(scan())[2:]
    )  # fmt: skip
    assert float(log_prob(model, field(), blind, pose)) == 0.0


@every_model
def test_moving_map_and_pose_together_changes_nothing(model):
    moved = field_of(room(), (-2.3 + 5.0, -1.8 - 7.0), RESOLUTION)
    shift = jnp.asarray([5.0, -7.0, 0.0], jnp.float32)
    # Offsets at which no end point lies within float32 of a cell's edge.
    for offset in (0.013, -0.047, 0.081):
        here = log_prob(model, field(), scan(), TRUE_POSE + offset)
        there = log_prob(model, moved, scan(), TRUE_POSE + offset + shift)
        assert float(here) == pytest.approx(float(there), abs=2e-3)


@every_model
def test_far_off_the_map_is_finite(model):
    for pose in ([1e4, -1e4, 1.0], [-2.2, -1.7, 0.0]):
        value = float(log_prob(model, field(), scan(), jnp.asarray(pose, jnp.float32)))
        assert np.isfinite(value)
        assert value < float(log_prob(model, field(), scan(), TRUE_POSE))
