"""The rule that decides whether to resample."""

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.resampling import AdaptiveResampling, SystematicResampler
from tests.checks import assert_strongly_typed

KEY = jax.random.key(0)


def adaptive(threshold=0.5):
    return AdaptiveResampling(SystematicResampler(), threshold)


# Two of four particles share the weight: ESS = 2 exactly, threshold · N = 2 at one half.
HALF = jnp.array([0.0, 0.0, -np.inf, -np.inf], jnp.float32)


@pytest.mark.parametrize(("threshold", "expected"), [(0.49, False), (0.5, False), (0.51, True)])
def test_it_resamples_below_the_threshold_and_not_at_it(threshold, expected):
    outcome = jax.jit(AdaptiveResampling.__call__)(adaptive(threshold), KEY, HALF)
    assert float(outcome.ess) == 2.0
    assert bool(outcome.resampled) is expected
    if expected:
        np.testing.assert_array_equal(outcome.ancestors, [0, 0, 1, 1])
        np.testing.assert_allclose(outcome.log_weights, np.log(0.25), rtol=1e-6)
    else:
        np.testing.assert_array_equal(outcome.ancestors, np.arange(4))
        np.testing.assert_allclose(np.exp(outcome.log_weights), [0.5, 0.5, 0.0, 0.0], rtol=1e-6)


def test_the_ancestors_are_those_of_the_scheme():
    log_weights = jax.random.normal(jax.random.key(5), (50,), jnp.float32) * 3.0
    outcome = adaptive()(KEY, log_weights)
    assert bool(outcome.resampled)
    np.testing.assert_array_equal(outcome.ancestors, SystematicResampler().ancestors(KEY, log_weights))


@pytest.mark.parametrize(("threshold", "expected"), [(0.0, False), (1.01, True)])
def test_the_threshold_can_turn_it_off_or_force_it(threshold, expected):
    for log_weights in (jnp.zeros(5, jnp.float32), jnp.array([0.0, -50.0, -50.0], jnp.float32)):
        assert bool(adaptive(threshold)(KEY, log_weights).resampled) is expected


@pytest.mark.parametrize("bad", [np.nan, -np.inf])
def test_a_lost_set_is_left_as_it_is(bad):
    outcome = adaptive(2.0)(KEY, jnp.full(4, bad, jnp.float32))
    assert not bool(outcome.resampled)
    np.testing.assert_array_equal(outcome.ancestors, np.arange(4))
    np.testing.assert_allclose(outcome.log_weights, np.log(0.25), rtol=1e-6)


def test_vmap_over_sets_is_the_loop():
    log_weights = jnp.stack([HALF, jnp.zeros(4), HALF * 0.0 + jnp.arange(4.0) * 5.0])
    log_weights = log_weights.astype(jnp.float32)
    keys = jax.random.split(KEY, 3)
    batched = jax.jit(jax.vmap(adaptive(0.6)))(keys, log_weights)
    assert batched.resampled.tolist() == [True, False, True]
    for i in range(3):
        one = jax.tree.map(lambda leaf, row=i: leaf[row], batched)
        chex.assert_trees_all_close(one, adaptive(0.6)(keys[i], log_weights[i]), rtol=1e-6)


def test_thresholds_can_be_vmapped():
    outcome = jax.vmap(lambda t: adaptive(t)(KEY, HALF).resampled)(jnp.array([0.4, 0.6]))
    assert outcome.tolist() == [False, True]


def test_outputs_are_strongly_typed():
    for log_weights in (HALF, jnp.full(4, -jnp.log(4.0))):
        shapes = jax.eval_shape(adaptive(), KEY, log_weights)
        types = [leaf.dtype for leaf in jax.tree.leaves(shapes)]
        assert types == [jnp.int32, jnp.float32, jnp.bool_, jnp.float32]
        assert_strongly_typed(shapes)


@pytest.mark.parametrize("threshold", [-0.1, float("nan")])
def test_a_bad_threshold_is_named(threshold):
    with pytest.raises(ValueError, match=f"threshold is {threshold}"):
        adaptive(threshold)
