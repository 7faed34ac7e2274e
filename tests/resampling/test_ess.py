"""Normalization and the effective sample size against scipy and hand-computed numbers."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.special

from jaxslam.resampling import effective_sample_size, normalize


def test_worked_examples_of_the_docstrings():
    log_weights = jnp.log(jnp.array([1.0, 3.0], jnp.float32))
    np.testing.assert_allclose(normalize(log_weights), np.log([0.25, 0.75]), rtol=1e-6)
    assert float(effective_sample_size(log_weights)) == pytest.approx(1.6, rel=1e-6)
    np.testing.assert_array_equal(normalize(jnp.array([np.nan, 5.0])), [-np.inf, 0.0])


@pytest.mark.parametrize("offset", [0.0, -1e4, 1e4])
@pytest.mark.parametrize("count", [1, 2, 30, 100_000])
def test_against_scipy_in_float64(count, offset):
    rng = np.random.default_rng(count)
    log_weights = (rng.normal(0.0, 2.0, count) + offset).astype(np.float32)
    exact = log_weights.astype(np.float64)
    normalized = exact - scipy.special.logsumexp(exact)
    ess = np.exp(-scipy.special.logsumexp(2.0 * normalized))
    # float32 around 20 is 1.9e-6 apart.
    np.testing.assert_allclose(normalize(jnp.asarray(log_weights)), normalized, atol=4e-6)
    found = float(effective_sample_size(jnp.asarray(log_weights)))
    assert found == pytest.approx(ess, rel=1e-5)


@pytest.mark.parametrize("count", [1, 7, 100_000])
def test_uniform_weights_are_worth_all_particles_exactly(count):
    assert float(effective_sample_size(jnp.full(count, -7.3, jnp.float32))) == float(count)


def test_one_particle_with_all_the_weight_is_worth_one():
    log_weights = jnp.array([-np.inf, 3.0, -200.0, -np.inf], jnp.float32)
    assert float(effective_sample_size(log_weights)) == 1.0


@pytest.mark.parametrize("bad", [np.nan, -np.inf, np.inf])
def test_a_lost_set_is_uniform(bad):
    log_weights = jnp.full(4, bad, jnp.float32)
    np.testing.assert_allclose(normalize(log_weights), np.log(0.25), rtol=1e-6)
    assert float(effective_sample_size(log_weights)) == 4.0


def test_what_is_not_finite_weighs_nothing():
    log_weights = jnp.array([np.nan, 0.0, np.inf, 0.0, -np.inf], jnp.float32)
    expected = [-np.inf, np.log(0.5), -np.inf, np.log(0.5), -np.inf]
    np.testing.assert_allclose(normalize(log_weights), expected, rtol=1e-6)
    assert float(effective_sample_size(log_weights)) == pytest.approx(2.0)


@pytest.mark.parametrize("function", [normalize, effective_sample_size])
def test_results_are_strongly_typed(function):
    # A weak input, as `jnp.full(n, -jnp.log(n))` makes one, must not pass its weakness on to a
    # carry.
    weak = jnp.full(3, -jnp.log(3.0))
    for log_weights in (weak, jnp.zeros(3, jnp.float32)):
        shape = jax.eval_shape(function, log_weights)
        assert (shape.dtype, shape.weak_type) == (jnp.float32, False)


def test_no_particles_is_an_error_that_says_so():
    with pytest.raises(ValueError, match="at least one particle"):
        normalize(jnp.zeros(0, jnp.float32))
