"""The omnidirectional model against numbers by hand; what all models must do is in the contract."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.motion import OmnidirectionalMotion
from tests.builders import odometry_of

NUM_SAMPLES = 100_000
# No two alike: an exchange of any two shows.
MODEL = OmnidirectionalMotion(
    rotation_noise_from_rotation=0.04,
    rotation_noise_from_translation=0.0025,
    translation_noise_from_translation=0.0016,
    translation_noise_from_rotation=0.0009,
    strafe_noise_from_translation=0.0036,
    translation_floor=0.001,
    rotation_floor=0.002,
)


@pytest.mark.parametrize(
    ("delta", "direction"),
    [((0.0, 0.5, 0.0), np.pi / 2), ((0.3, 0.4, 0.2), np.arctan2(4, 3)), ((-0.5, 0.0, -0.3), np.pi)],
    ids=["sideways", "diagonal", "backwards, turning"],
)
def test_moments_of_the_samples(delta, direction):
    keys = jax.random.split(jax.random.key(1), NUM_SAMPLES)
    samples = jax.jit(jax.vmap(MODEL.sample, (0, None, None)))(keys, jnp.zeros(3), odometry_of(delta))
    samples = np.asarray(samples, np.float64)
    np.testing.assert_allclose(samples.mean(axis=0), delta, atol=1e-3)
    along = samples[:, 0] * np.cos(direction) + samples[:, 1] * np.sin(direction)
    across = samples[:, 1] * np.cos(direction) - samples[:, 0] * np.sin(direction)
    # All three drive half a meter.
    turned = delta[2] ** 2
    expected = np.sqrt(
        [
            0.0016 * 0.25 + 0.0009 * turned + 0.001**2,
            0.0036 * 0.25 + 0.0009 * turned + 0.001**2,
            0.04 * turned + 0.0025 * 0.25 + 0.002**2,
        ]
    )
    found = np.std([along, across, samples[:, 2]], axis=1)
    np.testing.assert_allclose(found, expected, rtol=0.015)


def test_the_example_of_the_docstring():
    covariance = jax.jit(lambda m, o: m.covariance(o))(OmnidirectionalMotion(), odometry_of((0.0, 1.0, 0.0)))
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), [0.0583, 0.0583, 0.1118], atol=1e-4)
