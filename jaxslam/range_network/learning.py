"""Training of a network from readings, its selection by validation, and its held-out readings."""

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
"""Smallest number of distances with which every fifth is held out."""
_ENOUGH_TO_VALIDATE, _EVERY_OTHER = 6, 4
"""Smallest number of remaining distances with which every fourth is used for validation."""
_SAME = 1e-6

Method = Literal["levenberg-marquardt", "adam"]


@dataclass(frozen=True)
class Split:
    """Split of the readings into training, validation and held-out readings.

    A network of many neurons can learn a staircase: right at every training distance and wrong at all
    distances in between. It is therefore validated at other distances, and evaluated at yet others.

    Attributes:
        training: `[M]` the readings used for training.
        validation: `[M]` readings that decide when training stops and which network is kept; none if there
            are too few distances.
        held_out: `[M]` the readings used for neither.
    """

    training: Bool[np.ndarray, "M"]
    validation: Bool[np.ndarray, "M"]
    held_out: Bool[np.ndarray, "M"]

    @classmethod
    def from_readings(cls, readings: Readings, held_out: Sequence[float] | None = None) -> "Split":
        """Split readings by distance.

        The nearest and the farthest distance are used for training unless `held_out` names them, because a
        network does not extrapolate.

        Args:
            readings: all readings.
            held_out: distances to hold out, meters; None takes every fifth if there are ten or more.

        Raises:
            ValueError: there are no readings at a held-out distance, or fewer than two distances remain.
        """
        distances = readings.distances
        judged = _held_out(distances, held_out)
        rest = np.flatnonzero(~judged)
        if len(rest) < 2:
            left = f"one distance ({distances[rest[0]]:g} m) is" if len(rest) else "no distance is"
            raise ValueError(
                f"{left} left to learn from: range errors that vary with distance need two or more distances"
            )
        validates = np.zeros(len(distances), bool)
        if len(rest) >= _ENOUGH_TO_VALIDATE:
            validates[rest[1:-1][_EVERY_OTHER // 2 - 1 :: _EVERY_OTHER]] = True
        at = np.searchsorted(distances, readings.true)
        return cls(~judged[at] & ~validates[at], validates[at], judged[at])


def _held_out(distances: Float64[np.ndarray, "D"], named: Sequence[float] | None) -> Bool[np.ndarray, "D"]:
    """Return which distances are held out: the given ones, or every fifth if there are enough."""
    chosen = np.zeros(len(distances), bool)
    if named is None and len(distances) >= _ENOUGH_TO_HOLD_OUT:
        chosen[1:-1][_EVERY // 2 - 1 :: _EVERY] = True
    for value in named or ():
        nearest = int(np.argmin(np.abs(distances - value)))
        if not abs(distances[nearest] - value) <= _SAME:
            raise ValueError(
                f"no readings at the held-out distance {value:g} m: the nearest are at "
                f"{distances[nearest]:g} m"
            )
        chosen[nearest] = True
    return chosen


@dataclass(frozen=True)
class Attempt:
    """The best of the restarts with one size of network.

    Attributes:
        num_neurons: size of the hidden layer.
        rmse: root mean square error in training and in validation, meters.
        steps: training steps until the best validation error.
    """

    num_neurons: int
    rmse: tuple[float, float]
    steps: int


@dataclass(frozen=True)
class TrainingResult:
    """A network and how it was chosen.

    Attributes:
        network: the network with the lowest validation error over sizes and restarts.
        fit: its training.
        attempts: one per size.
        split: the split of the readings.
    """

    network: RangeNetwork
    fit: Fit
    attempts: tuple[Attempt, ...]
    split: Split


def check_sizes(neurons: Sequence[int], restarts: int) -> None:
    """Raise `ValueError` unless there is a size, every size is positive, and there is a restart."""
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
    """Train networks from several initializations and keep the one with the lowest validation error.

    Without validation readings, only the mean reading of each distance is learned. From so few distances, a
    network would fit a step to the scatter at each distance, and would be decimeters off in between.

    Args:
        key: PRNG key of the initializations.
        readings: all readings.
        split: the split of the readings.
        neurons: sizes of the hidden layer to choose from.
        restarts: trainings per size.
        method: training method.
        on_attempt: called after each size.

    Raises:
        ValueError: there is no size or restart, the readings are all equal, or every training diverged.
    """
    check_sizes(neurons, restarts)
    learnt_from, validates = readings.where(split.training), readings.where(split.validation)
    if not split.validation.any():
        learnt_from = validates = learnt_from.means()
    training, validation = (Rows.from_readings(part.measured, part.true) for part in (learnt_from, validates))
    # The trained interval ends with the training readings: beyond them the correction stays constant.
    shortest, longest = float(jnp.min(training.measured)), float(jnp.max(training.measured))
    if not longest > shortest:
        raise ValueError(
            f"the lidar read {shortest:g} m at every distance: check that its beam faces the wall"
        )
    fit = {"levenberg-marquardt": fit_levenberg_marquardt, "adam": fit_adam}[method]
    fits: list[Fit] = []
    for size, key_size in zip(neurons, jax.random.split(key, len(neurons)), strict=True):
        keys_start = jax.random.split(key_size, restarts)
        drawn = (RangeNetwork.draw(key_start, size, shortest, longest) for key_start in keys_start)
        fits.append(min((fit(network, training, validation) for network in drawn), key=_validation_error))
        if on_attempt is not None:
            on_attempt(_attempt(fits[-1]))
    best = min(fits, key=_validation_error)
    if not np.isfinite(_validation_error(best)):
        raise ValueError(
            "training diverged in every restart (non-finite loss): check that the readings come from a flat "
            "wall"
        )
    return TrainingResult(best.network, best, tuple(map(_attempt, fits)), split)


def _validation_error(fit: Fit) -> float:
    error = float(fit.mse[1])
    return error if np.isfinite(error) else np.inf


def _attempt(fit: Fit) -> Attempt:
    training, validation = np.sqrt(np.asarray(fit.mse, np.float64))
    return Attempt(fit.network.num_neurons, (float(training), float(validation)), int(fit.steps))
