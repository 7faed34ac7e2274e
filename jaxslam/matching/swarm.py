"""Fruit-fly optimization: the standard swarm and the improved one of Liang et al."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from jaxslam.core.validation import require_at_least_zero

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


class _Swarm(eqx.Module):
    """The flies, evaluated at their positions, and the best position so far."""

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
        require_at_least_zero(self, positive=("num_flies",))

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
        fitness: Callable[[Float[Array, "D"]], Float[Array, ""]],
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
        start = jnp.clip(start, lower, upper)
        first = _worst_if_nan(fitness(start))
        starts = jnp.broadcast_to(start[None], (self.num_flies, *start.shape))
        swarm = _Swarm(starts, jnp.broadcast_to(first[None], (self.num_flies,)), start, first)
        swarm, looks = self._fly(jax.vmap(fitness), key, swarm, scale, lower[None], upper[None])
        return SwarmResult(swarm.best, swarm.best_fitness, looks.best_fitness[:, -1])

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
        evaluate it with their own fitness. Each fly keeps the best position that it has evaluated. There are
        as many flies as starts; `num_flies` is not used.

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
        _, looks = self._fly(fitness, key, swarm, scale, lower, upper)
        positions = jnp.concatenate([starts[None], looks.position.reshape(-1, *starts.shape)])
        seen = jnp.concatenate([first[None], looks.fitness.reshape(-1, starts.shape[0])])
        # `argmax` takes the first of equals, so a fly that found nothing better stays at its start.
        best = jnp.argmax(seen, axis=0)
        flies = jnp.arange(starts.shape[0])
        return SwarmResult(positions[best, flies], seen[best, flies], looks.best_fitness[:, -1])

    def _fly(
        self,
        fitness: Callable[[Float[Array, "P D"]], Float[Array, "P"]],
        key: PRNGKeyArray,
        swarm: _Swarm,
        scale: Float[Array, "D"],
        lower: Float[Array, "_ D"],
        upper: Float[Array, "_ D"],
    ) -> tuple[_Swarm, _Swarm]:
        """Return the swarm after all generations, and each of its evaluations, leaves `[G, 1 or 2, ...]`."""

        def look(swarm: _Swarm, position: Float[Array, "P D"]) -> _Swarm:
            position = jnp.clip(position, lower, upper)
            found = _worst_if_nan(fitness(position))
            leader = jnp.argmax(found)
            better = found[leader] > swarm.best_fitness
            best = jnp.where(better, position[leader], swarm.best)
            return _Swarm(position, found, best, jnp.where(better, found[leader], swarm.best_fitness))

        def generation(swarm: _Swarm, drawn: _Draws) -> tuple[_Swarm, _Swarm]:
            step_scale = scale * jnp.power(jnp.asarray(self.shrink, jnp.float32), drawn.generation)
            swarm = look(swarm, swarm.position + self._steps(drawn.steps, step_scale))
            looks = [swarm]
            if self.improved:
                changed = swarm.position
                if self.crossover:
                    changed = _cross(drawn, changed, swarm.fitness)
                if self.mutation:
                    changed = self._mutate(drawn, changed, swarm, step_scale)
                swarm = look(swarm, changed)
                looks.append(swarm)
            # All flies move to the best one.
            gathered = jnp.clip(jnp.broadcast_to(swarm.best[None], swarm.position.shape), lower, upper)
            swarm = eqx.tree_at(lambda s: s.position, swarm, gathered)
            return swarm, jax.tree.map(lambda *leaves: jnp.stack(leaves), *looks)

        return jax.lax.scan(generation, swarm, self._draw(key, *swarm.position.shape))

    def _draw(self, key: PRNGKeyArray, num_flies: int, size: int) -> _Draws:
        """Draw the random numbers of all generations at once, which costs the same as for one."""
        pairs, mutants = num_flies // 2, min(self.num_mutants, num_flies)
        shapes = ((num_flies, size), (pairs,), (pairs, size), (mutants, size), (mutants, size))
        keys = jax.random.split(key, len(shapes))
        values = [
            jax.random.uniform(key, (self.num_generations, *shape), jnp.float32)
            for key, shape in zip(keys, shapes, strict=True)
        ]
        return _Draws(jnp.arange(self.num_generations, dtype=jnp.float32), *values)

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
        # A component changes with the adaptive probability (k2 = k4 = 0.5), and at least one does.
        chosen = drawn.mutant_which < _adaptive_rate(swarm.fitness, swarm.fitness, 0.5)[best][:, None]
        chosen = chosen | ~jnp.any(chosen, axis=1, keepdims=True)
        steps = jnp.where(chosen, self._steps(drawn.mutant_steps, scale), 0.0)
        return position.at[worst].set(swarm.position[best] + steps)


def _worst_if_nan(fitness: Float[Array, "*P"]) -> Float[Array, "*P"]:
    return jnp.where(jnp.isnan(fitness), -jnp.inf, fitness)


def _cross(drawn: _Draws, position: Float[Array, "P D"], fitness: Float[Array, "P"]) -> Float[Array, "P D"]:
    """Cross pairs with the adaptive probability (k1 = k3 = 1); an odd fly out stays unchanged.

    The flies have moved from one position by independent steps, so neighbors in the array are random pairs.
    """
    half = drawn.cross_whether.shape[0]
    left, right = position[:half], position[half : 2 * half]
    rate = _adaptive_rate(fitness, jnp.maximum(fitness[:half], fitness[half : 2 * half]), 1.0)
    share = jnp.where((drawn.cross_whether < rate)[:, None], drawn.cross_share, 1.0)
    one, other = share * left + (1.0 - share) * right, (1.0 - share) * left + share * right
    return jnp.concatenate([one, other, position[2 * half :]])


def _adaptive_rate(fitness: Float[Array, "P"], values: Float[Array, "n"], full: float) -> Float[Array, "n"]:
    """Return full · (f_max − f) / (f_max − f_mean) for values f above the mean, the full rate below it."""
    finite = jnp.isfinite(fitness)
    count = jnp.maximum(jnp.sum(finite, dtype=jnp.float32), 1.0)
    mean = jnp.sum(jnp.where(finite, fitness, 0.0)) / count
    largest = jnp.max(jnp.where(finite, fitness, -jnp.inf))
    spread = jnp.maximum(largest - mean, _NONE)
    rate = full * (largest - values) / spread
    # Also the full rate among equals, and where fitness is not finite.
    is_full = (values < mean) | ~jnp.isfinite(values) | (largest - mean <= _NONE)
    return jnp.where(is_full, full, jnp.clip(rate, 0.0, full))
