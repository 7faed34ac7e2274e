"""From readings to a network: what it learns from, what chooses it, and what it is judged by."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float64, PRNGKeyArray

from jaxslam.range_network.network import RangeNetwork
from jaxslam.range_network.readings import Readings
from jaxslam.range_network.training import Fit, Rows, fit_adam, fit_levenberg_marquardt

_ENOUGH_TO_HOLD_OUT, _EVERY = 10, 5
"""From so many distances on, every fifth is held out."""
_ENOUGH_TO_VALIDATE, _EVERY_OTHER = 6, 4
"""From so many others on, every fourth of them validates."""
_SAME = 1e-6

Method = Literal["levenberg-marquardt", "adam"]


@dataclass(frozen=True)
class Split:
    """Which readings the network learns from.

    A network of many neurons can learn a staircase: right at every distance that it has seen and at none in
    between. So it is validated at distances that it does not learn from, and judged at others still.

    Attributes:
        training: `[M]` the readings that it learns from.
        validation: `[M]` those that stop the training and choose the network; none where there are too few
            distances.
        held_out: `[M]` those that nothing is learnt or chosen by.
    """

    training: Bool[np.ndarray, "M"]
    validation: Bool[np.ndarray, "M"]
    held_out: Bool[np.ndarray, "M"]

    @classmethod
    def from_readings(cls, readings: Readings, held_out: Sequence[float] | None = None) -> "Split":
        """A split by distances.

        The nearest and the farthest distance are learnt from, unless they are named: a network does not
        extrapolate.

        Args:
            readings: all of them.
            held_out: distances to judge by, meters; None takes every fifth where there are ten or more.

        Raises:
            ValueError: a distance is none of the readings', or fewer than two are left to learn from.
        """
        distances = readings.distances
        judged = _named(distances, held_out) if held_out is not None else _every_fifth(distances)
        rest = np.flatnonzero(~judged)
        if len(rest) < 2:
            left = f"one distance ({distances[rest[0]]:g} m) is" if len(rest) else "no distance is"
            raise ValueError(
                f"{left} left to learn from: what a lidar is off by from one distance to another takes two "
                "or more"
            )
        validates = np.zeros(len(distances), bool)
        if len(rest) >= _ENOUGH_TO_VALIDATE:
            validates[rest[1:-1][_EVERY_OTHER // 2 - 1 :: _EVERY_OTHER]] = True
        at = np.searchsorted(distances, readings.true)
        return cls(~judged[at] & ~validates[at], validates[at], judged[at])


def _named(distances: Float64[np.ndarray, "D"], named: Sequence[float]) -> Bool[np.ndarray, "D"]:
    chosen = np.zeros(len(distances), bool)
    for value in named:
        nearest = int(np.argmin(np.abs(distances - value)))
        if not abs(distances[nearest] - value) <= _SAME:
            raise ValueError(
                f"no readings at {value:g} m, which are to be held out: the nearest are at "
                f"{distances[nearest]:g} m"
            )
        chosen[nearest] = True
    return chosen


def _every_fifth(distances: Float64[np.ndarray, "D"]) -> Bool[np.ndarray, "D"]:
    chosen = np.zeros(len(distances), bool)
    if len(distances) >= _ENOUGH_TO_HOLD_OUT:
        chosen[1:-1][_EVERY // 2 - 1 :: _EVERY] = True
    return chosen


@dataclass(frozen=True)
class Attempt:
    """One size of network, the best of its restarts.

    Attributes:
        num_neurons: of the hidden layer.
        rmse: in training and in validation, meters.
        steps: until the best validation error.
    """

    num_neurons: int
    rmse: tuple[float, float]
    steps: int


@dataclass(frozen=True)
class TrainingResult:
    """A network and how it was chosen.

    Attributes:
        network: that of the lowest validation error over sizes and restarts.
        fit: its training.
        attempts: one per size.
        split: of the readings.
    """

    network: RangeNetwork
    fit: Fit
    attempts: tuple[Attempt, ...]
    split: Split


def check_sizes(neurons: Sequence[int], restarts: int) -> None:
    """Raises a `ValueError` for sizes and restarts that nothing can be learnt with."""
    if not neurons or restarts < 1:
        raise ValueError(f"{len(neurons)} sizes and {restarts} restarts: give one or more of each")
    if small := [size for size in neurons if size < 1]:
        raise ValueError(f"num_neurons is {small[0]}: give 1 or more")


def learn(
    key: PRNGKeyArray,
    readings: Readings,
    split: Split,
    *,
    neurons: Sequence[int] = (50,),
    restarts: int = 5,
    method: Method = "levenberg-marquardt",
    on_attempt: Callable[[Attempt], None] | None = None,
) -> TrainingResult:
    """Trains networks from several starts and keeps the one that validates best.

    Where nothing validates, only the mean reading of each distance is learnt: from so few of them a network
    would learn the scatter of each as a step, and be decimeters off in between.

    Args:
        key: of the starts.
        readings: all of them.
        split: of the readings.
        neurons: sizes of the hidden layer to choose from.
        restarts: trainings per size.
        method: what trains them.
        on_attempt: is told of every size that is done.

    Raises:
        ValueError: no size, no restart, readings that cannot be learnt from, or a training that diverged.
    """
    check_sizes(neurons, restarts)
    learnt_from = readings.where(split.training)
    if split.validation.any():
        validates = readings.where(split.validation)
        training, validation = (
            Rows.from_readings(part.measured, part.true) for part in (learnt_from, validates)
        )
    else:
        means = learnt_from.means()
        training = validation = Rows.from_readings(means.measured, means.true)
    # Not beyond what it learns from: there the correction is held.
    shortest, longest = float(jnp.min(training.measured)), float(jnp.max(training.measured))
    if not longest > shortest:
        raise ValueError(f"the lidar read {shortest:g} m at every distance: does its beam face the wall?")
    fit = {"levenberg-marquardt": fit_levenberg_marquardt, "adam": fit_adam}[method]
    fits: list[Fit] = []
    for size, key_size in zip(neurons, jax.random.split(key, len(neurons)), strict=True):
        fits.append(
            min(
                (
                    fit(RangeNetwork.draw(key_start, size, shortest, longest), training, validation)
                    for key_start in jax.random.split(key_size, restarts)
                ),
                key=_validation_error,
            )
        )
        if on_attempt is not None:
            on_attempt(_attempt(fits[-1]))
    best = min(fits, key=_validation_error)
    if not np.isfinite(_validation_error(best)):
        raise ValueError("no training came to a number: are the readings those of a wall?")
    return TrainingResult(best.network, best, tuple(map(_attempt, fits)), split)


def _validation_error(fit: Fit) -> float:
    error = float(fit.mse[1])
    return error if np.isfinite(error) else np.inf


def _attempt(fit: Fit) -> Attempt:
    training, validation = np.sqrt(np.asarray(fit.mse, np.float64))
    return Attempt(fit.network.num_neurons, (float(training), float(validation)), int(fit.steps))
