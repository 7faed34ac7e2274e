"""Fruit-fly optimization: the standard swarm and the improved one of the first paper."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray

Fitness = Callable[[Float[Array, "D"]], Float[Array, ""]]

_NONE = 1e-12


class SwarmResult(eqx.Module):
    """The best place that a swarm has been to, or that each of its flies has.

    Attributes:
        position: `[D]`, or `[P, D]`.
        fitness: there, or `[P]`.
        history: `[G]` the swarm's best fitness so far after each generation.
    """

    position: Float[Array, "*P D"]
    fitness: Float[Array, "*P"]
    history: Float[Array, "G"]


class _Flight(eqx.Module):
    """What a generation leaves behind: where the flies were, `[2, P, D]` if they were also changed.

    Attributes:
        leader: the best fitness so far.
        positions: where fitness was asked for.
        fitness: there.
    """

    leader: Float[Array, "*G"]
    positions: Float[Array, "*G S P D"]
    fitness: Float[Array, "*G S P"]


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
    r"""Maximizes a fitness with a swarm.

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

    def maximize(
        self,
        fitness: Fitness,
        key: PRNGKeyArray,
        start: Float[Array, "D"],
        scale: Float[Array, "D"],
        lower: Float[Array, "D"] | None = None,
        upper: Float[Array, "D"] | None = None,
    ) -> SwarmResult:
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
        first = _worst_if_nan(fitness(jnp.clip(start, lower, upper)))
        swarm = _Swarm(
            position=jnp.broadcast_to(jnp.clip(start, lower, upper)[None], (self.num_flies, *start.shape)),
            fitness=jnp.broadcast_to(first[None], (self.num_flies,)),
            best=jnp.clip(start, lower, upper),
            best_fitness=first,
        )
        swarm, flights = self._fly(jax.vmap(fitness), key, swarm, scale, lower[None], upper[None])
        return SwarmResult(swarm.best, swarm.best_fitness, flights.leader)

    def maximize_each(
        self,
        fitness: Callable[[Float[Array, "P D"]], Float[Array, "P"]],
        key: PRNGKeyArray,
        starts: Float[Array, "P D"],
        scale: Float[Array, "D"],
        lower: Float[Array, "P D"],
        upper: Float[Array, "P D"],
    ) -> SwarmResult:
        """The best place found by every fly of a swarm whose flies see different landscapes.

        Each generation all go to the place of the best individual, within their own bounds, and look at it
        in their own landscape; each keeps the best that it has seen there. The number of flies is that of
        the starts, whatever `num_flies` is.

        Args:
            fitness: of the places of all flies `[P, D]`, of each in its own landscape, `[P]`.
            key: PRNG key; the same one gives the same bytes.
            starts: where each sets out.
            scale: of a step, per component.
            lower: least value per fly and component.
            upper: largest value.
        """
        starts = jnp.clip(starts, lower, upper)
        first = _worst_if_nan(fitness(starts))
        leader = jnp.argmax(first)
        swarm = _Swarm(starts, first, starts[leader], first[leader])
        _, flights = self._fly(fitness, key, swarm, scale, lower, upper)
        positions = jnp.concatenate([starts[None], flights.positions.reshape(-1, *starts.shape)])
        seen = jnp.concatenate([first[None], flights.fitness.reshape(-1, starts.shape[0])])
        # The first of equals: a fly that found nothing better stays where it set out.
        best = jnp.argmax(seen, axis=0)
        flies = jnp.arange(starts.shape[0])
        return SwarmResult(positions[best, flies], seen[best, flies], flights.leader)

    def _fly(
        self,
        fitness: Callable[[Float[Array, "P D"]], Float[Array, "P"]],
        key: PRNGKeyArray,
        swarm: _Swarm,
        scale: Float[Array, "D"],
        lower: Float[Array, "_ D"],
        upper: Float[Array, "_ D"],
    ) -> tuple[_Swarm, _Flight]:
        """All generations, from a swarm that has been scored where it is."""

        def generation(swarm: _Swarm, drawn: _Draws) -> tuple[_Swarm, _Flight]:
            step_scale = scale * jnp.power(jnp.asarray(self.shrink, jnp.float32), drawn.generation)
            flown = jnp.clip(swarm.position + self._steps(drawn.steps, step_scale), lower, upper)
            swarm = _record(swarm, flown, _worst_if_nan(fitness(flown)))
            looks = [swarm]
            if self.improved:
                changed = swarm.position
                if self.crossover:
                    changed = _cross(drawn, changed, swarm.fitness)
                if self.mutation:
                    changed = self._mutate(drawn, changed, swarm, step_scale)
                changed = jnp.clip(changed, lower, upper)
                swarm = _record(swarm, changed, _worst_if_nan(fitness(changed)))
                looks.append(swarm)
            # All flies go to the best individual.
            gathered = jnp.clip(jnp.broadcast_to(swarm.best[None], swarm.position.shape), lower, upper)
            flight = _Flight(
                swarm.best_fitness,
                jnp.stack([look.position for look in looks]),
                jnp.stack([look.fitness for look in looks]),
            )
            return eqx.tree_at(lambda s: s.position, swarm, gathered), flight

        return jax.lax.scan(generation, swarm, self._draw(key, *swarm.position.shape))

    def _draw(self, key: PRNGKeyArray, num_flies: int, size: int) -> _Draws:
        """All that is random, for all generations at once: a draw costs the same for one as for all."""
        generations = self.num_generations
        pairs, mutants = num_flies // 2, min(self.num_mutants, num_flies)
        shapes = ((num_flies, size), (pairs,), (pairs, size), (mutants, size), (mutants, size))
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
        best, worst = order[:count], order[order.shape[0] - count :]
        # A component changes with the adaptive probability, and at least one does.
        chosen = drawn.mutant_which < _mutation_rate(swarm.fitness)[best][:, None]
        chosen = chosen | ~jnp.any(chosen, axis=1, keepdims=True)
        steps = jnp.where(chosen, self._steps(drawn.mutant_steps, scale), 0.0)
        return position.at[worst].set(swarm.position[best] + steps)


def _worst_if_nan(fitness: Float[Array, "*P"]) -> Float[Array, "*P"]:
    return jnp.where(jnp.isnan(fitness), -jnp.inf, fitness)


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
