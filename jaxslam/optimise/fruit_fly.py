"""Fruit-fly optimisation: the standard swarm and the improved one of the first paper."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray

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


class _Draws(eqx.Module):
    """Numbers in [0, 1) for a generation; stacked over generations, `[G, ...]`."""

    generation: Float[Array, "*G"]
    steps: Float[Array, "*G P D"]
    cross_whether: Float[Array, "*G pairs"]
    cross_share: Float[Array, "*G pairs D"]
    mutant_which: Float[Array, "*G M D"]
    mutant_steps: Float[Array, "*G M D"]


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

        def generation(swarm: _Swarm, drawn: _Draws) -> tuple[_Swarm, Float[Array, ""]]:
            step_scale = scale * jnp.power(jnp.asarray(self.shrink, jnp.float32), drawn.generation)
            flown = within(swarm.position + self._steps(drawn.steps, step_scale))
            swarm = _record(swarm, flown, jax.vmap(score)(flown))
            if self.improved:
                changed = swarm.position
                if self.crossover:
                    changed = _cross(drawn, changed, swarm.fitness)
                if self.mutation:
                    changed = self._mutate(drawn, changed, swarm, step_scale)
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
        swarm, history = jax.lax.scan(generation, swarm, self._draw(key, start.shape[0]))
        return Found(swarm.best, swarm.best_fitness, history)

    def _draw(self, key: PRNGKeyArray, size: int) -> _Draws:
        """All that is random, for all generations at once: a draw costs the same for one as for all."""
        flies, generations = self.num_flies, self.num_generations
        pairs, mutants = flies // 2, min(self.num_mutants, flies)
        shapes = ((flies, size), (pairs,), (pairs, size), (mutants, size), (mutants, size))
        keys = jax.random.split(key, len(shapes))
        values = [
            jax.random.uniform(key, (generations, *shape), jnp.float32)
            for key, shape in zip(keys, shapes, strict=True)
        ]
        return _Draws(jnp.arange(generations, dtype=jnp.float32), *values)

    def _steps(self, drawn: Float[Array, "n D"], scale: Float[Array, "D"]) -> Float[Array, "n D"]:
        """Steps by tobacco (17) or (18), of numbers in [0, 1)."""
        signed = 2.0 * drawn - 1.0
        if self.exponential:
            signed = jnp.sign(signed) * jnp.expm1(jnp.abs(signed))
        return signed * scale[None]

    def _mutate(
        self, drawn: _Draws, position: Float[Array, "P D"], swarm: _Swarm, scale: Float[Array, "D"]
    ) -> Float[Array, "P D"]:
        """Mutated copies of the best flies in the places of the worst."""
        count = drawn.mutant_steps.shape[0]
        order = jnp.argsort(-swarm.fitness)
        best, worst = order[:count], order[self.num_flies - count :]
        # A component changes with the adaptive probability, and at least one does.
        chosen = drawn.mutant_which < _mutation_rate(swarm.fitness)[best][:, None]
        chosen = chosen | ~jnp.any(chosen, axis=1, keepdims=True)
        steps = jnp.where(chosen, self._steps(drawn.mutant_steps, scale), 0.0)
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


def _cross(drawn: _Draws, position: Float[Array, "P D"], fitness: Float[Array, "P"]) -> Float[Array, "P D"]:
    """Pairs crossed, with the adaptive probability; one fly of an odd number stays as it is.

    The flies have flown from one place by independent steps: any pairing is a random one.
    """
    half = drawn.cross_whether.shape[0]
    left, right = position[:half], position[half : 2 * half]
    rate = _crossover_rate(fitness, jnp.maximum(fitness[:half], fitness[half : 2 * half]))
    share = jnp.where((drawn.cross_whether < rate)[:, None], drawn.cross_share, 1.0)
    one, other = share * left + (1.0 - share) * right, (1.0 - share) * left + share * right
    return jnp.concatenate([one, other, position[2 * half :]])


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
