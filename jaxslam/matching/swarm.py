"""Fruit-fly optimization: the standard swarm and the improved one of Liang et al."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray

Fitness = Callable[[Float[Array, "D"]], Float[Array, ""]]

_NONE = 1e-12


class SwarmResult(eqx.Module):
    """The best position found by a swarm, or by each of its flies.

    Attributes:
        position: `[D]`, or `[P, D]`.
        fitness: fitness at that position, scalar or `[P]`.
        history: `[G]` the swarm's best fitness so far after each generation.
    """

    position: Float[Array, "*P D"]
    fitness: Float[Array, "*P"]
    history: Float[Array, "G"]


class _Flight(eqx.Module):
    """Record of a generation; with changed flies, it holds both evaluations, `[2, P, D]`.

    Attributes:
        leader: the best fitness so far.
        positions: the evaluated positions.
        fitness: their fitness.
    """

    leader: Float[Array, "*G"]
    positions: Float[Array, "*G S P D"]
    fitness: Float[Array, "*G S P"]


class _Swarm(eqx.Module):
    """The flies and the best position so far."""

    position: Float[Array, "P D"]
    fitness: Float[Array, "P"]
    best: Float[Array, "D"]
    best_fitness: Float[Array, ""]


class _Draws(eqx.Module):
    """Random numbers in [0, 1) for a generation; stacked over generations, `[G, ...]`."""

    generation: Float[Array, "*G"]
    steps: Float[Array, "*G P D"]
    cross_whether: Float[Array, "*G pairs"]
    cross_share: Float[Array, "*G pairs D"]
    mutant_which: Float[Array, "*G M D"]
    mutant_steps: Float[Array, "*G M D"]


class FruitFlies(eqx.Module):
    r"""Maximization of a fitness function by a swarm.

    In each generation the flies move, $x_k = x_{k-1} + \text{step}$ (Liang et al. 17). If the best of them
    beats all earlier ones, the whole swarm moves to its position. The step is uniform in ±scale; with
    `exponential` it is $\pm(e^r - 1)\cdot\text{scale}$ with r in [0, 1] (Liang et al. 18, with a random
    sign: as printed, positions only grow), up to 1.7 scale, and mostly short.

    The improved swarm changes the moved flies before they gather. With `crossover`, random pairs x and y
    become a·x + (1 − a)·y and the reverse, with the adaptive probability of Srinivas and Patnaik, which
    preserves flies of high fitness. With `mutation`, mutated copies of the best flies replace the worst. The
    changed flies are evaluated again, so a generation of the improved swarm costs twice the evaluations.

    The start is evaluated too, so the result is never worse than the start. A NaN is the worst fitness.

    Attributes:
        num_flies: P (static).
        num_generations: maxgen (static); with 0 the result is the start.
        exponential: use the steps of (18) instead of uniform ones (static).
        crossover: whether flies are crossed (static).
        mutation: whether copies of the best are mutated (static).
        num_mutants: number of mutated copies, up to P (static).
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
        """Return the swarm of Pan 2012, without the three improvements."""
        return cls(num_flies, num_generations, exponential=False, crossover=False, mutation=False)

    @property
    def improved(self) -> bool:
        """Return whether flies are changed after they have moved."""
        return self.crossover or self.mutation

    @property
    def num_evaluations(self) -> int:
        """Return the number of fitness evaluations, including the start's."""
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
        """Return the best position found from `start` `[D]`.

        Args:
            fitness: function of one position `[D]`, a scalar; it is vmapped.
            key: PRNG key; the same key gives the same bytes.
            start: initial position of all flies.
            scale: scale of a step, per component.
            lower: lower bound per component, None for no bound. Flies are clipped to the bounds.
            upper: upper bound.
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
        """Return the best position found by every fly of a swarm in which each fly has its own fitness.

        In each generation all flies move to the position of the best one, within their own bounds, and
        evaluate it with their own fitness. Each keeps the best position that it has evaluated. The number of
        flies is that of the starts; `num_flies` is not used.

        Args:
            fitness: maps the positions of all flies `[P, D]` to each fly's own fitness `[P]`.
            key: PRNG key; the same key gives the same bytes.
            starts: initial position of each fly.
            scale: scale of a step, per component.
            lower: lower bound per fly and component.
            upper: upper bound.
        """
        starts = jnp.clip(starts, lower, upper)
        first = _worst_if_nan(fitness(starts))
        leader = jnp.argmax(first)
        swarm = _Swarm(starts, first, starts[leader], first[leader])
        _, flights = self._fly(fitness, key, swarm, scale, lower, upper)
        positions = jnp.concatenate([starts[None], flights.positions.reshape(-1, *starts.shape)])
        seen = jnp.concatenate([first[None], flights.fitness.reshape(-1, starts.shape[0])])
        # `argmax` takes the first of equals, so a fly that found nothing better stays at its start.
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
        """Run all generations from a swarm that has been evaluated at its positions."""

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
            # All flies move to the best one.
            gathered = jnp.clip(jnp.broadcast_to(swarm.best[None], swarm.position.shape), lower, upper)
            flight = _Flight(
                swarm.best_fitness,
                jnp.stack([look.position for look in looks]),
                jnp.stack([look.fitness for look in looks]),
            )
            return eqx.tree_at(lambda s: s.position, swarm, gathered), flight

        return jax.lax.scan(generation, swarm, self._draw(key, *swarm.position.shape))

    def _draw(self, key: PRNGKeyArray, num_flies: int, size: int) -> _Draws:
        """Draw the random numbers of all generations at once, which costs the same as for one."""
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
        """Turn numbers in [0, 1) into steps by Liang et al. (17) or (18)."""
        signed = 2.0 * drawn - 1.0
        if self.exponential:
            signed = jnp.sign(signed) * jnp.expm1(jnp.abs(signed))
        return signed * scale[None]

    def _mutate(
        self, drawn: _Draws, position: Float[Array, "P D"], swarm: _Swarm, scale: Float[Array, "D"]
    ) -> Float[Array, "P D"]:
        """Replace the worst flies by mutated copies of the best."""
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
    """Return the swarm at new positions; the best is replaced only by a better one."""
    leader = jnp.argmax(fitness)
    better: Bool[Array, ""] = fitness[leader] > swarm.best_fitness
    return _Swarm(
        position=position,
        fitness=fitness,
        best=jnp.where(better, position[leader], swarm.best),
        best_fitness=jnp.where(better, fitness[leader], swarm.best_fitness),
    )


def _cross(drawn: _Draws, position: Float[Array, "P D"], fitness: Float[Array, "P"]) -> Float[Array, "P D"]:
    """Cross pairs with the adaptive probability; with an odd number, one fly stays unchanged.

    The flies have moved from one position by independent steps, so neighbors in the array are random pairs.
    """
    half = drawn.cross_whether.shape[0]
    left, right = position[:half], position[half : 2 * half]
    rate = _crossover_rate(fitness, jnp.maximum(fitness[:half], fitness[half : 2 * half]))
    share = jnp.where((drawn.cross_whether < rate)[:, None], drawn.cross_share, 1.0)
    one, other = share * left + (1.0 - share) * right, (1.0 - share) * left + share * right
    return jnp.concatenate([one, other, position[2 * half :]])


def _crossover_rate(fitness: Float[Array, "P"], fitter: Float[Array, "pairs"]) -> Float[Array, "pairs"]:
    """Return k1 (f_max − f′) / (f_max − f_mean) above the mean, k3 below it; k1 = k3 = 1."""
    return _adaptive(fitness, fitter, 1.0)


def _mutation_rate(fitness: Float[Array, "P"]) -> Float[Array, "P"]:
    """Return k2 (f_max − f) / (f_max − f_mean) above the mean, k4 below it; k2 = k4 = 0.5."""
    return _adaptive(fitness, fitness, 0.5)


def _adaptive(fitness: Float[Array, "P"], values: Float[Array, "n"], factor: float) -> Float[Array, "n"]:
    finite = jnp.isfinite(fitness)
    count = jnp.maximum(jnp.sum(finite, dtype=jnp.float32), 1.0)
    mean = jnp.sum(jnp.where(finite, fitness, 0.0)) / count
    largest = jnp.max(jnp.where(finite, fitness, -jnp.inf))
    spread = jnp.maximum(largest - mean, _NONE)
    rate = factor * (largest - values) / spread
    # The full rate below the mean, among equals, and where fitness is not finite.
    keep = (values < mean) | ~jnp.isfinite(values) | (largest - mean <= _NONE)
    return jnp.where(keep, factor, jnp.clip(rate, 0.0, factor))
