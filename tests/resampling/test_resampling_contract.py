"""What every resampling scheme must do, over a registry of all of them."""

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxslam.resampling
from jaxslam.resampling import (
    AbstractResampler,
    AdaptiveResampling,
    MultinomialResampler,
    ResidualResampler,
    StratifiedResampler,
    SystematicResampler,
)
from tests.checks import assert_strongly_typed, jit_once

SCHEMES = {
    "systematic": SystematicResampler(),
    "stratified": StratifiedResampler(),
    "residual": ResidualResampler(),
    "multinomial": MultinomialResampler(),
}
every_scheme = pytest.mark.parametrize("scheme", SCHEMES.values(), ids=SCHEMES.keys())
# All of one length, so that each scheme compiles once.
WEIGHTS = {
    "uneven": np.array([0.37, 0.0, 0.21, 0.02, 0.07, 0.04, 0.09, 0.2]),
    "uniform": np.full(8, 0.125),
    "whole": np.array([0.5, 0.25, 0.125, 0.125, 0.0, 0.0, 0.0, 0.0]),
    "one heavy": np.array([1e-4, 1e-4, 0.9993, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4]),
    "all on the last": np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]),
    "two": np.array([0.0, 0.3, 0.0, 0.0, 0.0, 0.7, 0.0, 0.0]),
}
NUM_KEYS = 20_000


def logs(weights) -> jnp.ndarray:
    with np.errstate(divide="ignore"):
        # An offset as a log-likelihood has: the scheme must normalize.
        return jnp.asarray(np.log(weights) - 250.0, jnp.float32)


@jax.jit
def ancestors_of(scheme, key, log_weights):
    return scheme.ancestors(key, log_weights)


@jax.jit
def counts_of(scheme, log_weights):
    """How often each particle was chosen, `[K, N]`, over fixed keys."""
    keys = jax.random.split(jax.random.key(7), NUM_KEYS)
    ancestors = jax.vmap(scheme.ancestors, in_axes=(0, None))(keys, log_weights)
    return jax.vmap(lambda a: jnp.bincount(a, length=log_weights.shape[0]))(ancestors)


def test_every_scheme_is_registered():
    public = {getattr(jaxslam.resampling, name) for name in jaxslam.resampling.__all__}
    schemes = {p for p in public if isinstance(p, type) and issubclass(p, AbstractResampler)}
    assert schemes - {AbstractResampler} == {type(scheme) for scheme in SCHEMES.values()}
    assert schemes - {AbstractResampler} == set(AbstractResampler.__subclasses__())


@every_scheme
@pytest.mark.parametrize("weights", WEIGHTS.values(), ids=WEIGHTS.keys())
def test_counts_are_unbiased(scheme, weights):
    counts = np.asarray(counts_of(scheme, logs(weights)), np.float64)
    count, expected = len(weights), len(weights) * weights
    np.testing.assert_array_equal(counts.sum(axis=1), count)
    # No scheme varies more than the binomial counts of the multinomial one. Five deviations of the
    # mean over the keys; 1e-5 N for float32 log-weights near −250, which are
    # 1.5e-5 apart.
    deviation = np.sqrt(count * weights * (1.0 - weights))
    bound = 5.0 * deviation / np.sqrt(NUM_KEYS) + 1e-5 * count
    np.testing.assert_array_less(np.abs(counts.mean(axis=0) - expected), bound)
    assert counts[:, weights == 0.0].sum() == 0.0


@every_scheme
@pytest.mark.parametrize("weights", WEIGHTS.values(), ids=WEIGHTS.keys())
def test_counts_stay_as_near_as_the_scheme_promises(scheme, weights):
    counts = np.asarray(counts_of(scheme, logs(weights)))
    expected = len(weights) * weights
    # 1e-5: a whole number N w may round to just above or below itself.
    floor, ceiling = np.floor(expected + 1e-5), np.ceil(expected - 1e-5)
    if isinstance(scheme, SystematicResampler):
        assert (counts >= floor).all()
        assert (counts <= ceiling).all()
    if isinstance(scheme, StratifiedResampler):
        assert (counts > expected - 2.0).all()
        assert (counts < expected + 2.0).all()
    if isinstance(scheme, ResidualResampler):
        assert (counts >= np.floor(expected - 1e-5)).all()


@every_scheme
def test_no_scheme_varies_more_than_the_multinomial(scheme):
    weights = WEIGHTS["uneven"]
    count, expected = len(weights), len(weights) * weights
    counts = np.asarray(counts_of(scheme, logs(weights)), np.float64)
    variance, fraction = counts.var(axis=0), expected - np.floor(expected)
    remainder = fraction.sum()
    exact = {
        SystematicResampler: fraction * (1.0 - fraction),
        ResidualResampler: fraction * (1.0 - fraction / remainder),
        MultinomialResampler: expected * (1.0 - weights),
        StratifiedResampler: _stratified_variance(weights),
    }
    # The variance of a sample variance is (μ₄ − σ⁴) / K; counts here have μ₄ < 4 σ⁴ + σ². Five
    # deviations.
    sigma_2 = exact[type(scheme)]
    bound = 5.0 * np.sqrt((3.0 * sigma_2**2 + sigma_2) / NUM_KEYS) + 1e-5
    np.testing.assert_array_less(np.abs(variance - sigma_2), bound)
    assert (exact[type(scheme)] <= count * weights * (1.0 - weights) + 1e-12).all()


def _stratified_variance(weights):
    """Σ over strata of p (1 − p), p the share of a stratum that a particle's interval covers."""
    edges = np.concatenate([[0.0], np.cumsum(weights)]) * len(weights)
    variance = np.zeros(len(weights))
    for i in range(len(weights)):
        for k in range(len(weights)):
            share = max(0.0, min(edges[i + 1], k + 1.0) - max(edges[i], float(k)))
            variance[i] += share * (1.0 - share)
    return variance


@every_scheme
@pytest.mark.parametrize("count", [1, 30, 100_000])
def test_many_particles_of_any_weight(scheme, count):
    rng = np.random.default_rng(count)
    log_weights = rng.normal(0.0, 3.0, count) - 1e4
    log_weights[rng.random(count) < 0.5] = -np.inf
    log_weights[-1] = -np.inf if count > 1 else -1e4
    log_weights[0] = -1e4
    log_weights = log_weights.astype(np.float32)
    weights = np.exp(log_weights.astype(np.float64) - np.max(log_weights))
    weights /= weights.sum()
    for seed in range(3):
        ancestors = np.asarray(ancestors_of(scheme, jax.random.key(seed), jnp.asarray(log_weights)))
        assert ancestors.min() >= 0
        assert ancestors.max() < count
        counts = np.bincount(ancestors, minlength=count)
        assert counts[np.isinf(log_weights)].sum() == 0
        expected = count * weights
        # A count is nearly Poisson of mean m, outside m ± (6 √m + 6) with probability below 1e-8
        # for every m, so 3 × 100 000 counts stay inside.
        if isinstance(scheme, MultinomialResampler):
            assert (np.abs(counts - expected) <= 6.0 * np.sqrt(expected) + 6.0).all()
        elif isinstance(scheme, ResidualResampler):
            # Float32 N w is good to 1e-6 of itself, so a floor may fall one short of a whole
            # number.
            assert (counts >= np.floor(expected * (1.0 - 1e-5))).all()
        else:
            reach = 1.0 if isinstance(scheme, SystematicResampler) else 2.0
            assert (np.abs(counts - expected) < reach + 1e-2 + 1e-6 * expected).all()


@every_scheme
def test_uniform_weights_of_many_particles_are_not_drawn_toward_one_end(scheme):
    count = 100_000
    ancestors = np.asarray(ancestors_of(scheme, jax.random.key(0), jnp.zeros(count, jnp.float32)))
    if not isinstance(scheme, MultinomialResampler | StratifiedResampler):
        np.testing.assert_array_equal(np.sort(ancestors), np.arange(count))
    # Of N draws the share in each tenth is binomial with deviation √(0.1 · 0.9 / N) = 9.5e-4; five
    # of them.
    share = np.bincount(ancestors // (count // 10), minlength=10) / count
    np.testing.assert_allclose(share, 0.1, atol=4.75e-3)


@every_scheme
@pytest.mark.parametrize("bad", [-np.inf, np.nan], ids=["-inf", "nan"])
def test_a_lost_set_keeps_every_particle(scheme, bad):
    log_weights = jnp.full(6, bad, jnp.float32)
    np.testing.assert_array_equal(
        scheme.ancestors(jax.random.key(0), log_weights), np.arange(6, dtype=np.int32)
    )


@every_scheme
def test_what_is_not_finite_does_not_go_on(scheme):
    log_weights = jnp.array([np.nan, 0.0, -np.inf, 0.5, np.inf], jnp.float32)
    keys = jax.random.split(jax.random.key(0), 200)
    ancestors = jax.jit(jax.vmap(scheme.ancestors, in_axes=(0, None)))(keys, log_weights)
    assert set(np.unique(ancestors)) == {1, 3}


@every_scheme
def test_one_particle_is_its_own_ancestor(scheme):
    assert int(scheme.ancestors(jax.random.key(0), jnp.array([-3.0]))[0]) == 0


@every_scheme
def test_no_particle_is_an_error_that_says_so(scheme):
    with pytest.raises(ValueError, match="log_weights has length 0"):
        scheme.ancestors(jax.random.key(0), jnp.zeros(0, jnp.float32))


@every_scheme
def test_jit_and_vmap_change_nothing(scheme):
    keys = jax.random.split(jax.random.key(1), 3)
    log_weights = jax.random.normal(jax.random.key(2), (3, 33), jnp.float32)
    one_by_one = np.stack(
        [ancestors_of(scheme, key, row) for key, row in zip(keys, log_weights, strict=True)]
    )
    batched = jax.jit(jax.vmap(scheme.ancestors))(keys, log_weights)
    not_jitted = scheme.ancestors(keys[0], log_weights[0])
    # The schemes pick by exact integers; only the float32 sum before them may differ by a bit.
    assert (np.asarray(batched) != one_by_one).mean() <= 0.01
    assert (np.asarray(not_jitted) != one_by_one[0]).mean() <= 0.01


@every_scheme
def test_ancestors_are_strongly_typed_int32(scheme):
    shape = jax.eval_shape(scheme.ancestors, jax.random.key(0), jnp.zeros(4, jnp.float32))
    chex.assert_trees_all_equal_shapes_and_dtypes(shape, jax.ShapeDtypeStruct((4,), jnp.int32))
    assert_strongly_typed(shape)


@every_scheme
def test_new_values_do_not_recompile_and_types_are_stable(scheme):
    step = jit_once(lambda resampling, key, log_weights: resampling(key, log_weights))
    log_weights = jnp.array([0.0, -5.0, -5.0], jnp.float32)
    outcomes = set()
    for threshold in (0.1, 0.5, 2.0):
        outcome = step(AdaptiveResampling(scheme, threshold), jax.random.key(0), log_weights)
        again = step(AdaptiveResampling(scheme, threshold), jax.random.key(1), outcome.log_weights)
        assert np.isfinite(again.ess)
        outcomes.add(bool(outcome.resampled))
    assert outcomes == {True, False}
