"""Training alone: rows for readings, Levenberg–Marquardt and Adam, and when they stop."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.range_network import RangeNetwork
from jaxslam.range_network.training import Rows, fit_levenberg_marquardt, mean_squared_error
from jaxslam.range_network.training import fit_adam as strict_fit_adam

LEARNT = np.linspace(0.12, 3.5, 35)
BETWEEN = (LEARNT[1:] + LEARNT[:-1]) / 2


def fit_adam(*args, **kwargs):
    """Adam under the promotion that optax needs: it multiplies floats by whole numbers."""
    with jax.numpy_dtype_promotion("standard"):
        return strict_fit_adam(*args, **kwargs)


def error_at(distance):
    """A smooth one, up to 52 mm."""
    return 0.03 * np.sin(2 * distance) + 0.01 * distance


def clean(distances) -> Rows:
    return Rows.from_readings(distances + error_at(distances), distances, resolution=1e-6)


def noisy(seed, sigma=0.01) -> Rows:
    """200 readings each centimeter, as a lidar gives them, in millimeters."""
    true = np.repeat(np.linspace(1.0, 1.2, 21), 200)
    measured = true + error_at(true) + np.random.default_rng(seed).normal(0.0, sigma, len(true))
    return Rows.from_readings(np.round(measured, 3), true)


def drawn(seed=0, rows=None, num_neurons=20) -> RangeNetwork:
    rows = clean(LEARNT) if rows is None else rows
    interval = float(rows.measured.min()), float(rows.measured.max())
    return RangeNetwork.draw(jax.random.key(seed), num_neurons, *interval)


def rmse_mm(fit) -> float:
    """Of the lowest training error."""
    return 1e3 * float(jnp.sqrt(jnp.nanmin(fit.history[:, 0])))


@pytest.mark.parametrize("seed", range(3))
def test_rows_keep_the_error_of_single_readings(seed):
    rng = np.random.default_rng(seed)
    true = np.repeat(np.linspace(1.0, 1.2, 21), 200)
    measured = np.round(true + error_at(true) + rng.normal(0.0, 0.01, len(true)), 3)
    rows = Rows.from_readings(measured, true)
    # Some 300 different millimeters, in each of which readings of several distances lie.
    assert len(np.unique(measured)) == len(rows.measured) < 400
    assert float(rows.scatter) > 1e-5
    assert float(rows.weight.sum()) == pytest.approx(1.0, abs=1e-6)
    network = drawn(seed, rows)
    corrected = np.asarray(network(jnp.asarray(measured, jnp.float32)), np.float64)
    expected = np.mean((corrected - true) ** 2)
    assert float(mean_squared_error(network, rows)) == pytest.approx(expected, rel=1e-4)


def test_rows_by_hand():
    rows = Rows.from_readings(np.array([1.0, 2.0, 1.0004, 1.0]), np.array([1.1, 2.1, 1.1, 1.4]))
    np.testing.assert_allclose(rows.measured, [1.0 + 0.0004 / 3, 2.0], rtol=1e-6)
    np.testing.assert_allclose(rows.true, [1.2, 2.1], rtol=1e-6)
    np.testing.assert_allclose(rows.weight, [0.75, 0.25], rtol=1e-6)
    # 0.1, 0.1 and 0.2 off their mean: 0.06 over four readings.
    assert float(rows.scatter) == pytest.approx(0.015, rel=1e-5)


@pytest.mark.parametrize("seed", range(4))
def test_levenberg_marquardt_recovers_a_smooth_curve(seed):
    fit = fit_levenberg_marquardt(drawn(seed), clean(LEARNT), clean(BETWEEN), 30)
    fine = np.linspace(LEARNT[0], LEARNT[-1], 1000)
    corrected = np.asarray(fit.network(jnp.asarray(fine + error_at(fine), jnp.float32)))
    # Raw it is off by up to 52 mm; the fit came out at 0.1 mm, between the distances as well.
    assert np.abs(corrected - fine).max() < 1e-3
    assert np.sqrt(fit.mse).max() < 1e-4
    # It is the interval of the readings still.
    assert (fit.network.shortest, fit.network.longest) == (drawn(seed).shortest, drawn(seed).longest)


@pytest.mark.parametrize("train", [fit_levenberg_marquardt, fit_adam])
def test_the_step_of_the_lowest_validation_error_is_kept(train):
    training, validation = noisy(0), noisy(1)
    fit = train(drawn(0, training), training, validation, 10, max_steps=200)
    history, steps = np.asarray(fit.history), int(fit.steps)
    taken = np.isfinite(history[:, 0])
    assert steps == np.argmin(history[taken, 1]) + 1
    # Then for as long as its patience lasts, and no longer.
    assert taken.sum() == min(steps + 10, 200)
    assert taken[: taken.sum()].all()
    np.testing.assert_array_equal(fit.mse, history[steps - 1])
    for rows, error in zip((training, validation), fit.mse, strict=True):
        assert float(mean_squared_error(fit.network, rows)) == pytest.approx(float(error), rel=1e-5)


def test_training_that_goes_on_overfits():
    """What early stopping is for: the last step is worse between the distances than the one that is kept."""
    scatter = np.random.default_rng(0).normal(0.0, 0.02, len(LEARNT))
    scattered = Rows.from_readings(LEARNT + error_at(LEARNT) + scatter, LEARNT, resolution=1e-6)
    fit = fit_levenberg_marquardt(drawn(0, scattered), scattered, clean(BETWEEN), 300)
    assert np.isfinite(fit.history).all()
    kept, last = fit.mse, fit.history[-1]
    assert float(last[0]) < float(kept[0])
    assert float(last[1]) > 1.5 * float(kept[1])


def test_no_more_steps_than_allowed():
    fit = fit_adam(drawn(), clean(LEARNT), clean(BETWEEN), 1000, max_steps=7)
    assert fit.history.shape == (7, 2)
    assert np.isfinite(fit.history).all()
    assert 1 <= int(fit.steps) <= 7


@pytest.mark.parametrize("seed", range(2))
def test_levenberg_marquardt_does_in_50_steps_what_adam_does_not_in_1000(seed):
    rows, network = clean(LEARNT), drawn(seed)
    second = fit_levenberg_marquardt(network, rows, rows, 1000, max_steps=50)
    # Came out at 0.02 to 0.03 mm, against 0.9 to 1.3 mm of Adam after 1000 steps and over 2 mm after 50.
    assert rmse_mm(second) < 0.1
    for learning_rate in (1e-3, 3e-3, 1e-2):
        first = fit_adam(network, rows, rows, 10_000, learning_rate=learning_rate, max_steps=1000)
        assert np.isfinite(first.history).all()
        assert rmse_mm(first) > 2 * rmse_mm(second)
        # It does learn: this is no straw man.
        assert rmse_mm(first) < 3.0


@pytest.mark.parametrize("train", [fit_levenberg_marquardt, fit_adam])
def test_same_start_same_bytes(train):
    fits = [train(drawn(seed), clean(LEARNT), clean(BETWEEN), 30) for seed in (1, 1, 2)]
    one, two, other = ([np.asarray(leaf).tobytes() for leaf in jax.tree.leaves(fit)] for fit in fits)
    assert one == two
    assert one != other
