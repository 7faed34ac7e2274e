"""Fruit-fly optimisation: the standard swarm and the improved one of the first paper."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

Fitness = Callable[[Float[Array, "D"]], Float[Array, ""]]

_NONE = 1e-12


class Found(eqx.Module):
    """The best place that a swarm has been to.

    Attributes:
        position: `[D]`.
        fitness: there.
        history: `[G]` best fitness so far after each generation.
    """

    position: Float[Array, "D"]
    fitness: Float[Array, ""]
    history: Float[Array, "G"]


class _Swarm(eqx.Module):
    """Flies, and the best of all so far."""

    position: Float[Array, "P D"]
    fitness: Float[Array, "P"]
    best: Float[Array, "D"]
    best_fitness: Float[Array, ""]


class FruitFlies(eqx.Module):
    r"""Maximises a fitness with a swarm.

    Each generation the flies fly off, $x_k = x_{k-1} + \text{step}$ (tobacco 17), and where the best of them
    beats all before, the whole swarm goes to it. The step is uniform in ±scale; with `exponential` it is
    $\pm(e^r - 1)\cdot\text{scale}$ with r in [0, 1] (tobacco 18, with a random sign: as printed it only ever
    grows), up to 1.7 scale, with most of them short.

    Between flying and gathering, the improved swarm changes the flies that have flown: with `crossover`,
    random pairs swap parts of themselves, x and y to a·x + (1 − a)·y and the reverse, with the adaptive
    probability of Srinivas and Patnaik, which spares the fit; and with `mutation`, copies of the best are
    mutated by a step and take the places of the worst. What came out is scored again, so a generation of the
    improved swarm costs twice the evaluations.

    The start counts as seen, so the result is never worse than it; a NaN is the worst fitness there is.

    Attributes:
        num_flies: P (static).
        num_generations: maxgen (static); with 0 the start comes back.
        exponential: steps by (18) instead of uniform ones (static).
        crossover: whether flies are crossed (static).
        mutation: whether copies of the best are mutated (static).
        num_mutants: how many, up to P (static).
        shrink: factor on the scale from each generation to the next.

    References:
        Pan 2012 (the standard swarm); Srinivas and Patnaik 1994 (adaptive probabilities, k1 = k3 = 1,
        k2 = k4 = 0.5).
    """

    num_flies: int = eqx.field(static=True, default=20)
    num_generations: int = eqx.field(static=True, default=10)
    exponential: bool = eqx.field(static=True, default=True)
    crossover: bool = eqx.field(static=True, default=True)
    mutation: bool = eqx.field(static=True, default=True)
    num_mutants: int = eqx.field(static=True, default=4)
    shrink: float | Float[Array, ""] = 1.0

    def __check_init__(self):
        if self.num_flies < 1:
            raise ValueError(f"num_flies is {self.num_flies}: give 1 or more")
        if self.num_generations < 0:
            raise ValueError(f"num_generations is {self.num_generations}: give 0 or more")
        if self.num_mutants < 0:
            raise ValueError(f"num_mutants is {self.num_mutants}: give 0 or more")

    @classmethod
    def standard(cls, num_flies: int = 20, num_generations: int = 10) -> "FruitFlies":
        """The swarm of Pan 2012, without the three improvements."""
        return cls(num_flies, num_generations, exponential=False, crossover=False, mutation=False)

    @property
    def improved(self) -> bool:
        """Whether flies are changed after they have flown."""
        return self.crossover or self.mutation

    @property
    def num_evaluations(self) -> int:
        """How often the fitness is asked for, the start's included."""
        return 1 + self.num_generations * self.num_flies * (2 if self.improved else 1)

    def maximise(
        self,
        fitness: Fitness,
        key: PRNGKeyArray,
        start: Float[Array, "D"],
        scale: Float[Array, "D"],
        lower: Float[Array, "D"] | None = None,
        upper: Float[Array, "D"] | None = None,
    ) -> Found:
        """The best place found from `start` `[D]`.

        Args:
            fitness: of one place `[D]`, a scalar; it is vmapped.
            key: PRNG key; the same one gives the same bytes.
            start: where all flies set out.
            scale: of a step, per component.
            lower: least value per component, None for no bound. A fly that would leave stays on it.
            upper: largest value.
        """
        lower = jnp.full_like(start, -jnp.inf) if lower is None else lower
        upper = jnp.full_like(start, jnp.inf) if upper is None else upper

        def score(position: Float[Array, "D"]) -> Float[Array, ""]:
            value = fitness(position)
            return jnp.where(jnp.isnan(value), -jnp.inf, value)

        def within(position: Float[Array, "P D"]) -> Float[Array, "P D"]:
            return jnp.clip(position, lower[None], upper[None])

        def generation(swarm: _Swarm, inputs: tuple[Array, Array]) -> tuple[_Swarm, Float[Array, ""]]:
            key, index = inputs
            key_fly, key_cross, key_mutate = jax.random.split(key, 3)
            step_scale = scale * jnp.power(jnp.asarray(self.shrink, jnp.float32), index)
            flown = within(swarm.position + self._steps(key_fly, self.num_flies, step_scale))
            swarm = _record(swarm, flown, jax.vmap(score)(flown))
            if self.improved:
                changed = swarm.position
                if self.crossover:
                    changed = _cross(key_cross, changed, swarm.fitness)
                if self.mutation:
                    changed = self._mutate(key_mutate, changed, swarm, step_scale)
                changed = within(changed)
                swarm = _record(swarm, changed, jax.vmap(score)(changed))
            # All flies go to the best individual.
            gathered = jnp.broadcast_to(swarm.best[None], swarm.position.shape)
            swarm = eqx.tree_at(lambda s: s.position, swarm, gathered)
            return swarm, swarm.best_fitness

        start = jnp.clip(start, lower, upper)
        first = score(start)
        swarm = _Swarm(
            position=jnp.broadcast_to(start[None], (self.num_flies, *start.shape)),
            fitness=jnp.broadcast_to(first[None], (self.num_flies,)),
            best=start,
            best_fitness=first,
        )
        indices = jnp.arange(self.num_generations, dtype=jnp.float32)
        keys = jax.random.split(key, self.num_generations)
        swarm, history = jax.lax.scan(generation, swarm, (keys, indices))
        return Found(swarm.best, swarm.best_fitness, history)

    def _steps(self, key: PRNGKeyArray, count: int, scale: Float[Array, "D"]) -> Float[Array, "count D"]:
        """Random steps, tobacco (17) or (18)."""
        drawn = jax.random.uniform(key, (count, scale.shape[0]), jnp.float32, -1.0, 1.0)
        if self.exponential:
            drawn = jnp.sign(drawn) * jnp.expm1(jnp.abs(drawn))
        return drawn * scale[None]

    def _mutate(
        self, key: PRNGKeyArray, position: Float[Array, "P D"], swarm: _Swarm, scale: Float[Array, "D"]
    ) -> Float[Array, "P D"]:
        """Mutated copies of the best flies in the places of the worst."""
        key_steps, key_which = jax.random.split(key)
        count = min(self.num_mutants, self.num_flies)
        order = jnp.argsort(-swarm.fitness)
        best, worst = order[:count], order[self.num_flies - count :]
        # A component changes with the adaptive probability, and at least one does.
        rate = _mutation_rate(swarm.fitness)[best]
        chosen = jax.random.uniform(key_which, (count, scale.shape[0])) < rate[:, None]
        chosen = chosen | ~jnp.any(chosen, axis=1, keepdims=True)
        steps = jnp.where(chosen, self._steps(key_steps, count, scale), 0.0)
        return position.at[worst].set(swarm.position[best] + steps)


def _record(swarm: _Swarm, position: Float[Array, "P D"], fitness: Float[Array, "P"]) -> _Swarm:
    """The flies where they are now; the best is replaced only by a better one."""
    leader = jnp.argmax(fitness)
    better: Bool[Array, ""] = fitness[leader] > swarm.best_fitness
    return _Swarm(
        position=position,
        fitness=fitness,
        best=jnp.where(better, position[leader], swarm.best),
        best_fitness=jnp.where(better, fitness[leader], swarm.best_fitness),
    )


def _cross(
    key: PRNGKeyArray, position: Float[Array, "P D"], fitness: Float[Array, "P"]
) -> Float[Array, "P D"]:
    """Random pairs crossed, with the adaptive probability; one fly of an odd number stays as it is."""
    key_pairs, key_whether, key_share = jax.random.split(key, 3)
    half = position.shape[0] // 2
    order: Int[Array, "P"] = jax.random.permutation(key_pairs, position.shape[0])
    one, other = order[:half], order[half : 2 * half]
    rate = _crossover_rate(fitness, jnp.maximum(fitness[one], fitness[other]))
    crossed = jax.random.uniform(key_whether, (half,)) < rate
    share = jax.random.uniform(key_share, (half, position.shape[1]))
    share = jnp.where(crossed[:, None], share, 1.0)
    left, right = position[one], position[other]
    position = position.at[one].set(share * left + (1.0 - share) * right)
    return position.at[other].set((1.0 - share) * left + share * right)


def _crossover_rate(fitness: Float[Array, "P"], fitter: Float[Array, "pairs"]) -> Float[Array, "pairs"]:
    """k1 (f_max − f′) / (f_max − f_mean) over the mean, k3 below it; k1 = k3 = 1."""
    return _adaptive(fitness, fitter, 1.0)


def _mutation_rate(fitness: Float[Array, "P"]) -> Float[Array, "P"]:
    """k2 (f_max − f) / (f_max − f_mean) over the mean, k4 below it; k2 = k4 = 0.5."""
    return _adaptive(fitness, fitness, 0.5)


def _adaptive(fitness: Float[Array, "P"], values: Float[Array, "n"], factor: float) -> Float[Array, "n"]:
    finite = jnp.isfinite(fitness)
    count = jnp.maximum(jnp.sum(finite, dtype=jnp.float32), 1.0)
    mean = jnp.sum(jnp.where(finite, fitness, 0.0)) / count
    largest = jnp.max(jnp.where(finite, fitness, -jnp.inf))
    spread = jnp.maximum(largest - mean, _NONE)
    rate = factor * (largest - values) / spread
    # Below the mean, among equals, and for what has no fitness: the full rate.
    keep = (values < mean) | ~jnp.isfinite(values) | (largest - mean <= _NONE)
    return jnp.where(keep, factor, jnp.clip(rate, 0.0, factor))
