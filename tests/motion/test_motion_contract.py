"""What every motion model must do, over a registry of all of them."""

import functools

import chex
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxslam.motion
from jaxslam.core import se2
from jaxslam.motion import (
    AbstractMotionModel,
    GaussianMotion,
    OdometryMotion,
    OmnidirectionalMotion,
    VelocityMotion,
)
from jaxslam.motion._wheel_noise import AbstractWheelModel
from tests import builders
from tests.checks import assert_strongly_typed, jit_once

MODELS = {
    "odometry": OdometryMotion(),
    "velocity": VelocityMotion(),
    "omnidirectional": OmnidirectionalMotion(),
    "gaussian": GaussianMotion(),
}
# The noise a fifth of the default's: second-order terms fall below the sampling error.
QUIET_MODELS = {
    "odometry": OdometryMotion(8e-4, 4e-4, 4e-4, 1e-4, 0.001, 0.001, 0.002),
    "velocity": VelocityMotion(4e-4, 1e-4, 4e-4, 4e-4, 2e-4, 2e-4, 0.001, 0.001),
    "omnidirectional": OmnidirectionalMotion(8e-4, 4e-4, 4e-4, 1e-4, 4e-4, 0.001, 0.001),
    "gaussian": GaussianMotion(0.04, 0.001, 0.001),
}
INCREMENTS = {
    "still": (0.0, 0.0, 0.0),
    "forward": (0.5, 0.02, 0.1),
    "backward": (-0.5, 0.03, -0.1),
    "curve": (0.4, 0.15, 0.7),
    "turn": (0.0, 0.0, 0.5),
    "turn, jittering": (0.004, -0.003, -0.5),
    "sideways": (0.0, 0.3, 0.0),
    "half turn": (0.1, 0.0, -3.1),
}
COVARIANCE = np.array([[4e-3, 1e-3, 2e-3], [1e-3, 2e-3, -1e-3], [2e-3, -1e-3, 5e-3]])
POSE = jnp.array([3.0, -2.0, 2.5], jnp.float32)
NUM_SAMPLES = 100_000
odometry_of = functools.partial(builders.odometry_of, covariance=COVARIANCE, dt=0.5)


@jax.jit
def sample_many(model, odometry):
    keys = jax.random.split(jax.random.key(3), NUM_SAMPLES)
    return jax.vmap(model.sample, in_axes=(0, None, None))(keys, POSE, odometry)


@jax.jit
def covariance_of(model, odometry):
    return model.covariance(odometry)


@jax.jit
def errors_of(poses, odometry):
    predicted = se2.compose(POSE, odometry.delta)
    return jax.vmap(se2.relative, in_axes=(None, 0))(predicted, poses)


@jax.jit
def log_prob_of_errors(model, errors, odometry):
    predicted = se2.compose(POSE, odometry.delta)
    poses = jax.vmap(se2.compose, in_axes=(None, 0))(predicted, errors)
    return jax.vmap(model.log_prob, in_axes=(0, None, None))(poses, POSE, odometry)


@jax.jit
def everything(model, pose_next, pose, odometry):
    """All outputs of a model, and the gradient of its density by all inputs."""
    log_prob = jax.value_and_grad(type(model).log_prob, argnums=(0, 1, 2, 3))
    return (
        model.sample(jax.random.key(0), pose, odometry),
        model.covariance(odometry),
        log_prob(model, pose_next, pose, odometry),
    )


def test_every_model_is_registered():
    public = {getattr(jaxslam.motion, name) for name in jaxslam.motion.__all__}
    public -= {AbstractMotionModel}
    below = {*AbstractMotionModel.__subclasses__(), *AbstractWheelModel.__subclasses__()}
    assert public == {type(model) for model in MODELS.values()} == below - {AbstractWheelModel}


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("increment", [i for i in INCREMENTS if i != "half turn"])
def test_covariance_is_that_of_the_samples(name, increment):
    odometry = odometry_of(INCREMENTS[increment])
    model = QUIET_MODELS[name]
    errors = np.asarray(errors_of(sample_many(model, odometry), odometry), np.float64)
    covariance = np.asarray(covariance_of(model, odometry), np.float64)
    deviation = np.sqrt(np.diag(covariance))

    # An entry of a sample covariance has deviation √((C_ii C_jj + C_ij²) / n) ≤ √(2 / n) √(C_ii
    # C_jj), 0.0045 of the scale; five of them, and 0.01 for the second order: where the direction
    # threshold leaves a translation t of its own size, (σ_along / t)² of the variance across is
    # second order.
    scale = np.outer(deviation, deviation)
    np.testing.assert_array_less(np.abs(np.cov(errors.T) - covariance) / scale, 0.0325)
    # Five standard errors of the mean, and the ½ t σ_θ² by which a bent path is shorter.
    length = np.linalg.norm(INCREMENTS[increment][:2])
    bound = 5.0 * deviation / np.sqrt(NUM_SAMPLES) + 0.5 * length * covariance[2, 2]
    np.testing.assert_array_less(np.abs(errors.mean(axis=0)), bound)
    np.testing.assert_array_equal(covariance, covariance.T)
    assert np.linalg.eigvalsh(covariance).min() > 0.0


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("increment", ["still", "forward", "backward", "curve", "turn, jittering"])
def test_density_integrates_to_one_and_predicts_the_histogram(name, increment):
    odometry = odometry_of(INCREMENTS[increment])
    model = MODELS[name]
    factor = np.linalg.cholesky(np.asarray(covariance_of(model, odometry), np.float64))
    # Mid-points of cubes of side 0.25 in coordinates where the samples are about standard normal.
    step = 0.25
    axis = np.arange(-6.0, 6.0, step) + 0.5 * step
    whitened = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    errors = jnp.asarray(whitened @ factor.T, jnp.float32)
    density = np.exp(np.asarray(log_prob_of_errors(model, errors, odometry), np.float64))
    mass = density * step**3 * np.linalg.det(factor)
    # The mid-point rule is exact to 1e-6 on a normal density sampled four times per deviation, and
    # the box of ± 6 deviations holds all but 1e-8; what remains is float32 in log_prob, |log p| ≈
    # 10.
    np.testing.assert_allclose(mass.sum(), 1.0, atol=2e-3)

    samples = np.asarray(errors_of(sample_many(model, odometry), odometry), np.float64)
    edges = np.array([-7.0, -1.0, 0.0, 1.0, 7.0])
    samples_whitened = np.clip(np.linalg.solve(factor, samples.T).T, -6.5, 6.5)
    observed, _ = np.histogramdd(samples_whitened, bins=[edges] * 3)
    expected, _ = np.histogramdd(whitened, bins=[edges] * 3, weights=mass)
    # Five binomial deviations of the 64 bins, and 0.002 for the second-order closed form.
    bound = 5.0 * np.sqrt(expected / NUM_SAMPLES) + 0.002
    np.testing.assert_array_less(np.abs(observed / NUM_SAMPLES - expected), bound)


@pytest.mark.parametrize("name", MODELS)
def test_density_penalizes_what_the_samples_do_not_reach(name):
    odometry = odometry_of(INCREMENTS["forward"])
    far = jnp.array([[5.0, 0.0, 0.0], [0.0, 5.0, 0.0], [0.0, 0.0, 3.0]], jnp.float32)
    errors = jnp.concatenate([jnp.zeros((1, 3), jnp.float32), far])
    at_near, *at_far = np.asarray(log_prob_of_errors(MODELS[name], errors, odometry))
    assert np.isfinite(at_far).all()
    assert (np.array(at_far) < at_near - 100.0).all()


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("increment", INCREMENTS)
@pytest.mark.parametrize("dt", [0.0, 0.5])
def test_values_and_gradients_are_finite(name, increment, dt):
    odometry = odometry_of(INCREMENTS[increment], dt=dt, covariance=np.zeros((3, 3)))
    pose_next = POSE + odometry.delta
    chex.assert_tree_all_finite(everything(MODELS[name], pose_next, POSE, odometry))


@pytest.mark.parametrize("name", MODELS)
def test_jit_and_vmap_change_nothing(name):
    model, odometry = MODELS[name], odometry_of(INCREMENTS["curve"])
    keys = jax.random.split(jax.random.key(1), 3)
    poses = jax.random.normal(jax.random.key(2), (3, 3), jnp.float32)

    def step(model, key, pose):
        pose_next = model.sample(key, pose, odometry)
        return pose_next, model.log_prob(pose_next, pose, odometry)

    jitted = jax.jit(step)
    one_by_one = [jitted(model, k, p) for k, p in zip(keys, poses, strict=True)]
    poses_next, log_probs = jax.jit(jax.vmap(step, in_axes=(None, 0, 0)))(model, keys, poses)
    # Without jit each operation compiles by itself: the cheapest model stands for all.
    not_jitted = [step(model, keys[0], poses[0])] if name == "gaussian" else []
    # Poses of size 4 carry 2.4e-7 m of rounding, against deviations of 5 mm and more.
    for i, (pose_next, log_prob) in enumerate([*one_by_one, *not_jitted]):
        np.testing.assert_allclose(poses_next[i % 3], pose_next, atol=1e-6)
        np.testing.assert_allclose(log_probs[i % 3], log_prob, atol=1e-3)


@pytest.mark.parametrize("name", MODELS)
def test_outputs_are_strongly_typed_float32(name):
    model, odometry = MODELS[name], odometry_of(INCREMENTS["forward"])
    outputs = [
        jax.eval_shape(model.sample, jax.random.key(0), POSE, odometry),
        jax.eval_shape(model.log_prob, POSE, POSE, odometry),
        jax.eval_shape(model.covariance, odometry),
    ]
    expected = [jax.ShapeDtypeStruct(shape, jnp.float32) for shape in ((3,), (), (3, 3))]
    chex.assert_trees_all_equal_shapes_and_dtypes(outputs, expected)
    assert_strongly_typed(outputs)


@pytest.mark.parametrize("name", MODELS)
def test_new_parameter_values_do_not_recompile(name):
    odometry, model = odometry_of(INCREMENTS["forward"]), MODELS[name]

    @jit_once
    def step(model, key, pose):
        pose_next = model.sample(key, pose, odometry)
        return model.log_prob(pose_next, pose, odometry), model.covariance(odometry)

    results = {float(step(model, jax.random.key(0), POSE)[0])}
    for field in vars(model):
        changed = eqx.tree_at(lambda m, f=field: getattr(m, f), model, 0.123)
        log_prob, covariance = step(changed, jax.random.key(0), POSE)
        assert np.isfinite(covariance).all()
        results.add(float(log_prob))
    assert len(results) == 1 + len(vars(model))


@pytest.mark.parametrize("name", MODELS)
def test_a_sweep_over_a_parameter_can_be_vmapped(name):
    odometry, model = odometry_of(INCREMENTS["still"]), MODELS[name]
    floors = jnp.array([0.01, 0.02], jnp.float32)
    sweep = jax.jit(
        jax.vmap(lambda floor: eqx.tree_at(lambda m: m.rotation_floor, model, floor).covariance(odometry))
    )(floors)
    increase = float(sweep[1, 2, 2] - sweep[0, 2, 2])
    assert increase == pytest.approx(0.02**2 - 0.01**2, rel=1e-3)


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize(
    ("field", "value"),
    [("rotation_floor", 0.0), ("translation_floor", -1.0), ("rotation_floor", float("nan"))],
)
def test_a_bad_parameter_is_named_with_its_value(name, field, value):
    with pytest.raises(ValueError, match=rf"{field} is {value}, must be > 0"):
        type(MODELS[name])(**{field: value})


def test_a_negative_noise_is_refused():
    with pytest.raises(ValueError, match=r"rotation_noise_from_rotation is -0\.2, must be >= 0"):
        OdometryMotion(rotation_noise_from_rotation=-0.2)
