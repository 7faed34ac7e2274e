"""Training by Levenberg–Marquardt with early stopping on validation readings."""

from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax
import numpy as np
import optax
import optimistix
from jaxtyping import Array, Float, Float64, Int

from jaxslam.core.types import Scalar
from jaxslam.range_network.network import RangeNetwork


class Rows(eqx.Module):
    """Readings for training, in which equal readings form one row, weighted by their number.

    The squared error summed over rows differs from that over single readings by a constant.

    Attributes:
        measured: `[R]` meters.
        true: `[R]` mean true distance of the row's readings, meters.
        weight: `[R]` share of the row among all readings; the sum is 1.
        scatter: mean variance of the true distances within rows, m²: the constant above.
    """

    measured: Float[Array, "R"]
    true: Float[Array, "R"]
    weight: Float[Array, "R"]
    scatter: Float[Array, ""]

    @classmethod
    def from_readings(
        cls, measured: Float64[np.ndarray, "M"], true: Float64[np.ndarray, "M"], resolution: float = 1e-3
    ) -> "Rows":
        """Group one or more readings and their true distances, both `[M]`, meters, into rows.

        Readings that are equal after rounding to `resolution`, meters, form one row; a lidar's own is 1 mm.
        """
        cells, row = np.unique(np.round(measured / resolution).astype(np.int64), return_inverse=True)
        count = np.bincount(row, minlength=len(cells)).astype(float)
        mean_measured, mean_true, mean_square = (
            np.bincount(row, values, len(cells)) / count for values in (measured, true, true * true)
        )
        scatter = np.sum(count * np.maximum(mean_square - mean_true**2, 0.0)) / len(measured)
        narrow = partial(jnp.asarray, dtype=jnp.float32)
        return cls(narrow(mean_measured), narrow(mean_true), narrow(count / len(measured)), narrow(scatter))


class Fit(eqx.Module):
    """Result of one training.

    Attributes:
        network: the network with the lowest validation error.
        steps: steps taken to reach it.
        history: `[T, 2]` mean squared error in training and in validation after each step, m²; NaN for steps
            that were not taken.
    """

    network: RangeNetwork
    steps: Int[Array, ""]
    history: Float[Array, "T 2"]

    @property
    def mse(self) -> Float[Array, "2"]:
        """Return the mean squared error of the kept network in training and in validation, m²."""
        return self.history[jnp.maximum(self.steps - 1, 0)]


def mean_squared_error(network: RangeNetwork, rows: Rows) -> Float[Array, ""]:
    """Return the mean squared error over the readings behind the rows, m²."""
    residuals = network(rows.measured) - rows.true
    return jnp.sum(rows.weight * residuals * residuals) + rows.scatter


@partial(jax.jit, static_argnames="max_steps")
def fit_levenberg_marquardt(
    network: RangeNetwork,
    training: Rows,
    validation: Rows,
    patience: int | Int[Array, ""] = 30,
    *,
    max_steps: int = 300,
) -> Fit:
    """Train by Levenberg–Marquardt with early stopping.

    Args:
        network: the initial network.
        training: readings for training.
        validation: other readings, whose error decides when to stop and which step is kept.
        patience: training stops after this number of steps without a lower validation error.
        max_steps: largest number of steps (static).

    References:
        Jamaludin et al.; the solver is optimistix's.
    """
    solver: Any = optimistix.LevenbergMarquardt(
        rtol=1e-8, atol=1e-8, linear_solver=lineax.Normal(lineax.Cholesky())
    )

    def residuals(parameters: RangeNetwork, rows: Rows) -> tuple[Float[Array, "R"], None]:
        trained = eqx.combine(parameters, network)
        return jnp.sqrt(rows.weight) * (trained(rows.measured) - rows.true), None

    start = _parameters(network)
    shape = jax.eval_shape(lambda: residuals(start, training)[0])
    begun = solver.init(residuals, start, training, {}, shape, None, frozenset())
    arrays, static = eqx.partition(begun, eqx.is_array)

    def step(parameters: RangeNetwork, arrays: Any) -> tuple[RangeNetwork, Any]:
        state = eqx.combine(arrays, static)
        parameters, state, _ = solver.step(residuals, parameters, training, {}, state, frozenset())
        return parameters, eqx.filter(state, eqx.is_array)

    return _early_stopping(network, step, arrays, training, validation, patience, max_steps)


@partial(jax.jit, static_argnames="max_steps")
def fit_adam(
    network: RangeNetwork,
    training: Rows,
    validation: Rows,
    patience: int | Int[Array, ""] = 1000,
    *,
    learning_rate: Scalar = 3e-3,
    max_steps: int = 20_000,
) -> Fit:
    """Train by Adam on all readings at once, for comparison; otherwise like `fit_levenberg_marquardt`."""
    optimizer = optax.adam(learning_rate)

    def loss(parameters: RangeNetwork) -> Float[Array, ""]:
        return mean_squared_error(eqx.combine(parameters, network), training)

    def step(parameters: RangeNetwork, state: Any) -> tuple[RangeNetwork, Any]:
        updates, state = optimizer.update(jax.grad(loss)(parameters), state)
        return optax.apply_updates(parameters, updates), state

    state = optimizer.init(_parameters(network))
    return _early_stopping(network, step, state, training, validation, patience, max_steps)


def _early_stopping(
    network: RangeNetwork,
    step: Any,
    state: Any,
    training: Rows,
    validation: Rows,
    patience: int | Int[Array, ""],
    max_steps: int,
) -> Fit:
    """Take steps until the validation error has not fallen for `patience` steps; keep the best."""

    def going(carry: tuple) -> Array:
        _, _, _, best_step, done, _ = carry
        return (done < max_steps) & (done - best_step < patience)

    def body(carry: tuple) -> tuple:
        parameters, state, best, best_step, done, history = carry
        parameters, state = step(parameters, state)
        trained = eqx.combine(parameters, network)
        now = jnp.stack([mean_squared_error(trained, rows) for rows in (training, validation)])
        history = history.at[done].set(now)
        lowest = jnp.where(best_step > 0, history[jnp.maximum(best_step - 1, 0), 1], jnp.inf)
        better = now[1] < lowest
        best = jax.tree.map(lambda new, old: jnp.where(better, new, old), parameters, best)
        return parameters, state, best, jnp.where(better, done + 1, best_step), done + 1, history

    start, zero = _parameters(network), jnp.zeros((), jnp.int32)
    carry = (start, state, start, zero, zero, jnp.full((max_steps, 2), jnp.nan, jnp.float32))
    _, _, best, best_step, _, history = jax.lax.while_loop(going, body, carry)
    return Fit(eqx.combine(best, network), best_step, history)


def _parameters(network: RangeNetwork) -> RangeNetwork:
    """Return the network without its interval, which is not trained; `eqx.combine` puts it back."""
    return eqx.tree_at(lambda n: (n.shortest, n.longest), network, (None, None))
