"""Fruit flies on standard functions, and what must hold for every fitness."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.matching.swarm import FruitFlies
from tests.checks import jit_once

STANDARD, IMPROVED = FruitFlies.standard(20, 60), FruitFlies(20, 30)
SEEDS = 20


def sphere(x):
    return -jnp.sum(x * x)


def rosenbrock(x):
    return -(100.0 * (x[1] - x[0] ** 2) ** 2 + (1.0 - x[0]) ** 2)


def rastrigin(x):
    return -jnp.sum(x * x - 10.0 * jnp.cos(2 * jnp.pi * x) + 10.0)


def ackley(x):
    near = -20.0 * jnp.exp(-0.2 * jnp.sqrt(jnp.mean(x * x)))
    return -(near - jnp.exp(jnp.mean(jnp.cos(2 * jnp.pi * x))) + 20.0 + jnp.e)


@functools.partial(jax.jit, static_argnums=0)
def run(fitness, flies, key, start, scale):
    return flies.maximize(fitness, key, start, scale)


def results(fitness, flies, start, scale):
    keys = jax.random.split(jax.random.key(0), SEEDS)
    start = jnp.asarray(start, jnp.float32)
    many = jax.vmap(run, (None, None, 0, None, None))
    return np.asarray(many(fitness, flies, keys, start, jnp.full_like(start, scale)).fitness)


@pytest.mark.parametrize("flies", [STANDARD, IMPROVED], ids=["standard", "improved"])
@pytest.mark.parametrize(
    ("fitness", "start", "scale", "near"),
    [(sphere, (2.0, -1.0, 1.5), 0.3, 0.05), (rosenbrock, (-1.0, 1.0), 0.2, 0.5)],
)
def test_smooth_functions_are_climbed(flies, fitness, start, scale, near):
    assert np.median(results(fitness, flies, start, scale)) > -near


@pytest.mark.parametrize(("fitness", "start"), [(rastrigin, (3.0, -2.0)), (ackley, (3.0, -2.0))])
def test_the_improved_swarm_escapes_where_the_standard_one_stays(fitness, start):
    """Steps of half a basin's width, and as many evaluations for both."""
    assert STANDARD.num_evaluations == IMPROVED.num_evaluations
    standard, improved = (results(fitness, flies, start, 0.6) for flies in (STANDARD, IMPROVED))
    assert improved.mean() > standard.mean()


@pytest.mark.parametrize(
    "flies",
    [
        STANDARD,
        IMPROVED,
        FruitFlies(1, 5),
        FruitFlies(20, 0),
        FruitFlies(7, 4, mutation=False),
        FruitFlies(6, 4, crossover=False),
        FruitFlies(3, 4, num_mutants=10),
        FruitFlies(3, 4, num_mutants=0),
    ],
    ids=str,
)
def test_never_worse_than_the_start_and_history_never_falls(flies):
    start = jnp.asarray([0.3, -0.2], jnp.float32)
    found = run(ackley, flies, jax.random.key(4), start, jnp.full(2, 5.0, jnp.float32))
    assert float(found.fitness) >= float(ackley(start))
    assert found.history.shape == (flies.num_generations,)
    assert np.all(np.diff(found.history) >= 0)
    np.testing.assert_allclose(found.fitness, ackley(found.position), rtol=1e-5)


def test_the_same_key_gives_the_same_bytes():
    start, scale = jnp.asarray([1.0, 1.0], jnp.float32), jnp.ones(2, jnp.float32)
    one, same, other = (run(ackley, IMPROVED, jax.random.key(k), start, scale).position for k in (1, 1, 2))
    assert one.tobytes() == same.tobytes()
    assert one.tobytes() != other.tobytes()


def test_bounds_hold():
    lower, upper = jnp.asarray([0.5, -1.0], jnp.float32), jnp.asarray([2.0, -0.25], jnp.float32)
    found = jax.jit(lambda key: IMPROVED.maximize(sphere, key, jnp.ones(2), jnp.ones(2), lower, upper))(
        jax.random.key(0)
    )
    np.testing.assert_allclose(found.position, [0.5, -0.25], atol=0.02)


def test_a_nan_never_wins():
    def torn(x):
        return jnp.where(x[0] > 0.5, jnp.nan, x[0])

    found = run(torn, IMPROVED, jax.random.key(0), jnp.zeros(2), jnp.full(2, 0.3, jnp.float32))
    assert 0.3 < float(found.fitness) <= 0.5
    everywhere = run(lambda x: x[0] * jnp.nan, IMPROVED, jax.random.key(0), jnp.zeros(2), jnp.ones(2))
    np.testing.assert_array_equal(everywhere.position, np.zeros(2))


def test_the_exponential_step_is_that_of_the_paper():
    """±(e^r − 1), r in [0, 1]: up to 1.718, and half of them under e^½ − 1 = 0.649."""
    drawn = jax.random.uniform(jax.random.key(0), (4000, 1), jnp.float32)
    steps = np.asarray(FruitFlies()._steps(drawn, jnp.ones(1, jnp.float32)))
    assert np.abs(steps).max() <= np.e - 1
    # The standard error of a share of one half among 4000 is 0.008.
    assert abs(np.mean(np.abs(steps) < np.exp(0.5) - 1) - 0.5) < 0.04
    assert abs(np.mean(steps > 0) - 0.5) < 0.04


def test_new_floats_do_not_recompile():
    @jit_once
    def maximize(flies, scale):
        return flies.maximize(sphere, jax.random.key(0), jnp.ones(2), scale).position

    for shrink in (1.0, 0.9):
        maximize(FruitFlies(shrink=jnp.float32(shrink)), jnp.full(2, shrink, jnp.float32))


PEAKS = jnp.asarray([[0.0, 0.0], [0.5, -0.3], [-0.4, 0.2], [0.1, 0.6]], jnp.float32)
STARTS = jnp.asarray([[0.3, 0.3], [0.2, -0.6], [-0.1, 0.5], [0.4, 0.2]], jnp.float32)


def own_hills(positions):
    """Every fly has a landscape of its own, the hill at its own place."""
    return -jnp.sum((positions - PEAKS) ** 2, axis=1)


@functools.partial(jax.jit, static_argnums=0)
def run_each(fitness, flies, key, lower, upper):
    return flies.maximize_each(fitness, key, STARTS, jnp.full(2, 0.2, jnp.float32), lower, upper)


@pytest.mark.parametrize(
    "flies", [FruitFlies.standard(1, 30), FruitFlies(1, 30)], ids=["standard", "improved"]
)
def test_every_fly_climbs_its_own_hill_and_keeps_its_own_best(flies):
    """All go to the best individual each time, so that a fly far from it looks at its own hill from there."""
    found = run_each(own_hills, flies, jax.random.key(0), STARTS - 1.0, STARTS + 1.0)
    np.testing.assert_allclose(own_hills(found.position), found.fitness, atol=1e-6)
    assert (np.asarray(found.fitness) >= np.asarray(own_hills(STARTS))).all()
    # The leader's hill is climbed to the top; history is the leader's.
    assert float(found.fitness.max()) > -0.01
    assert float(found.history[-1]) == pytest.approx(float(found.fitness.max()), abs=1e-6)
    assert np.all(np.diff(found.history) >= 0)


def test_flies_stay_within_their_own_bounds_though_they_go_to_the_best():
    lower, upper = STARTS - 0.05, STARTS + 0.05
    found = run_each(own_hills, FruitFlies(1, 10), jax.random.key(1), lower, upper)
    assert (np.asarray(found.position) >= np.asarray(lower)).all()
    assert (np.asarray(found.position) <= np.asarray(upper)).all()
    # The first fly's hill lies beyond its bounds: its best place is the corner next to it.
    np.testing.assert_allclose(found.position[0], lower[0], atol=1e-3)


def test_a_swarm_of_one_is_a_swarm():
    start = jnp.asarray([[0.3, 0.3]], jnp.float32)
    found = FruitFlies(1, 5).maximize_each(
        lambda x: -jnp.sum(x * x, axis=1), jax.random.key(0), start, jnp.full(2, 0.2), start - 1, start + 1
    )
    assert float(found.fitness[0]) > -0.18


def test_a_fly_that_sees_nothing_stays_where_it_set_out():
    def torn(positions):
        return jnp.where(jnp.arange(4) == 2, jnp.nan, own_hills(positions))

    found = run_each(torn, FruitFlies(1, 10), jax.random.key(2), STARTS - 1.0, STARTS + 1.0)
    np.testing.assert_array_equal(found.position[2], STARTS[2])
    assert float(found.fitness[2]) == -np.inf
    assert np.isfinite(found.fitness).sum() == 3


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"num_flies": 0}, "num_flies is 0, must be > 0"),
        ({"num_generations": -1}, "num_generations is -1, must be >= 0"),
        ({"num_mutants": -1}, "num_mutants is -1, must be >= 0"),
    ],
)
def test_impossible_swarms_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        FruitFlies(**arguments)
