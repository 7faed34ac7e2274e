"""The bias of one cheap lidar, what it does to readings, and readings of a wall."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import jaxtyping
import numpy as np
import pytest

from jaxslam.sim import (
    Lidar,
    RangeBias,
    calibration_distances,
    calibration_run,
    draw_lds_01_bias,
    lds_01,
    lds_01_accuracy,
)

NUM_READINGS = 40_000
FINE = jnp.linspace(0.05, 4.0, 2000)


def readings(lidar: Lidar, distance: float, seed: int = 0) -> np.ndarray:
    """Those that came back, of one wall."""
    ranges, valid = lidar.measure(jax.random.key(seed), jnp.full((1, NUM_READINGS), distance))
    return np.asarray(ranges, np.float64)[np.asarray(valid)]


def without_noise(lidar: Lidar) -> Lidar:
    return dataclasses.replace(lidar, sigma_constant=0.0, sigma_proportional=0.0)


def test_the_accuracy_is_the_data_sheets() -> None:
    near, far = lds_01_accuracy(jnp.array([0.12, 0.5])), lds_01_accuracy(jnp.array([1.5, 3.5]))
    np.testing.assert_allclose(near, 0.015, rtol=1e-6)
    # 15 mm and 5 % of what is beyond 0.5 m: under the data sheet's 5 % of all.
    np.testing.assert_allclose(far, [0.065, 0.165], rtol=1e-6)
    assert (lds_01_accuracy(FINE) <= jnp.maximum(0.015, 0.05 * FINE) + 1e-7).all()


@pytest.mark.parametrize("share", [0.3, 0.6])
def test_a_bias_stays_within_the_accuracy_and_reaches_its_share(share: float) -> None:
    keys = jax.random.split(jax.random.key(1), 100)
    biases = jax.vmap(lambda key: draw_lds_01_bias(key, share))(keys)
    relative = np.abs(biases.offsets) / np.asarray(lds_01_accuracy(biases.distances))
    np.testing.assert_allclose(relative.max(axis=1), share, rtol=1e-5)
    everywhere = jax.vmap(lambda bias: bias(FINE))(biases)
    # Beyond the range of the lidar the bias of its end is held; the accuracy of the end is as wide or wider.
    held = jnp.clip(FINE, 0.12, 3.5)
    assert (np.abs(everywhere) <= np.asarray(lds_01_accuracy(held))[None]).all()
    # No constant: every device is off either way somewhere.
    assert (np.asarray(biases.offsets).min(axis=1) < 0).all()
    assert (np.asarray(biases.offsets).max(axis=1) > 0).all()


def test_same_key_same_device() -> None:
    one, two, other = (draw_lds_01_bias(jax.random.key(seed)) for seed in (1, 1, 2))
    assert np.asarray(one.offsets).tobytes() == np.asarray(two.offsets).tobytes()
    assert np.abs(one.offsets - other.offsets).max() > 0.01


def test_a_bias_is_linear_between_its_distances_and_held_beyond() -> None:
    bias = RangeBias(jnp.array([1.0, 2.0, 4.0]), jnp.array([0.1, -0.1, 0.3]))
    np.testing.assert_allclose(
        bias(jnp.array([0.5, 1.0, 1.25, 3.0, 9.0])), [0.1, 0.1, 0.05, 0.1, 0.3], rtol=1e-5
    )


@pytest.mark.parametrize("shapes", [((3,), (2,)), ((2, 2), (2, 2)), ((), ())], ids=str)
def test_shapes_that_do_not_match_are_refused(shapes: tuple, monkeypatch: pytest.MonkeyPatch) -> None:
    distances, offsets = map(jnp.zeros, shapes)
    with pytest.raises(jaxtyping.TypeCheckError):
        RangeBias(distances, offsets)
    # A user has no type checker.
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    with pytest.raises(ValueError, match="give one offset per distance") as error:
        RangeBias(distances, offsets)
    assert f"shape {shapes[0]} and offsets {shapes[1]}" in str(error.value)


def test_readings_are_the_distance_and_the_bias() -> None:
    bias = draw_lds_01_bias(jax.random.key(3))
    distances = jnp.linspace(0.3, 3.2, 50)[None]
    ranges, valid = without_noise(lds_01(bias)).measure(jax.random.key(0), distances)
    assert valid.all()
    np.testing.assert_allclose(ranges, distances + bias(distances), rtol=1e-6)


@pytest.mark.parametrize("distance", [0.4, 1.7, 3.0])
def test_the_mean_of_noisy_readings_is_the_distance_and_the_bias(distance: float) -> None:
    bias = RangeBias(jnp.array([0.0, 4.0]), jnp.array([0.01, 0.05]))
    biased, plain = readings(lds_01(bias), distance), readings(lds_01(), distance)
    assert len(biased) == len(plain) == NUM_READINGS
    # Four standard errors: 200 is the root of the number of readings.
    standard_error = plain.std() / 200
    assert biased.mean() == pytest.approx(distance + 0.01 * (1 + distance), abs=4 * standard_error)
    assert plain.mean() == pytest.approx(distance, abs=4 * standard_error)
    # The noise is that of the true distance, reading by reading.
    np.testing.assert_allclose(biased - plain, 0.01 * (1 + distance), atol=1e-6)


def test_a_lidar_without_bias_is_one_with_none_anywhere() -> None:
    nothing = RangeBias(jnp.array([0.0, 4.0]), jnp.zeros(2))
    assert lds_01().bias is None
    assert readings(lds_01(), 2.0).tobytes() == readings(lds_01(nothing), 2.0).tobytes()


def test_what_is_not_hit_has_no_bias_either() -> None:
    bias = RangeBias(jnp.array([0.0, 4.0]), jnp.array([1.0, 1.0]))
    ranges, valid = lds_01(bias).measure(jax.random.key(0), jnp.full((1, 8), math.inf))
    assert not valid.any()
    np.testing.assert_array_equal(ranges, 0.0)


@pytest.mark.parametrize(
    ("distance", "sigma"),
    # ±10 mm are three standard deviations; beyond 0.5 m the root of (10/3)² + (0.035/3 · 2500)² mm².
    [(0.4, 0.003333), (3.0, 0.029356)],
)
def test_noise_of_the_lds_01(distance: float, sigma: float) -> None:
    # Four standard errors of a standard deviation: 4/√80 000 = 1.4 % of it.
    assert readings(lds_01(), distance).std() == pytest.approx(sigma, rel=0.014)


def test_calibration_distances_of_the_lds_01() -> None:
    distances = np.asarray(calibration_distances(lds_01()))
    assert len(distances) == 35
    np.testing.assert_allclose(distances[:34], 0.12 + 0.1 * np.arange(34), rtol=1e-6)
    assert distances[-1] == pytest.approx(3.5)


@pytest.mark.parametrize(
    ("longest", "expected"),
    # Three steps from 1 m are not quite 1.3 m in floats; 1.4 m is too near to 1.43 m.
    [
        (1.3, [1.0, 1.1, 1.2, 1.3]),
        (1.43, [1.0, 1.1, 1.2, 1.3, 1.43]),
        (1.47, [1.0, 1.1, 1.2, 1.3, 1.4, 1.47]),
    ],
)
def test_the_longest_range_comes_once(longest: float, expected: list[float]) -> None:
    lidar = dataclasses.replace(lds_01(), range_min=1.0, range_max=longest)
    np.testing.assert_allclose(calibration_distances(lidar, 0.1), expected, rtol=1e-6)


@pytest.mark.parametrize("step", [0.0, -0.1, math.nan])
def test_steps_that_lead_nowhere_are_refused(step: float) -> None:
    with pytest.raises(ValueError, match="give a positive step and span"):
        calibration_distances(lds_01(), step)


def test_a_calibration_run_loses_readings_at_the_limits() -> None:
    lidar = lds_01()
    distances = calibration_distances(lidar)
    ranges, valid = (np.asarray(part) for part in calibration_run(jax.random.key(0), lidar, distances, 2000))
    assert ranges.shape == valid.shape == (35, 2000)
    np.testing.assert_array_equal(ranges[~valid], 0.0)
    # Half of a symmetric noise lies beyond a limit, give or take four deviations of a share: 4·√(0.25/2000).
    share = valid.mean(axis=1)
    np.testing.assert_allclose(share[[0, -1]], 0.5, atol=0.045)
    # At 3.42 m it is 80 mm to the limit, which is 2.3 standard deviations of 34 mm; elsewhere 5 or more.
    assert 0.95 < share[-2] < 1.0
    assert (share[1:-3] == 1.0).all()
    means = np.where(valid, ranges, 0.0).sum(axis=1) / valid.sum(axis=1)
    np.testing.assert_allclose(means[1:-3], distances[1:-3], atol=4 * 0.034 / 2000**0.5)


def test_a_calibration_run_has_the_noise_of_its_key() -> None:
    lidar, distances = lds_01(), jnp.array([1.0, 2.0])
    one, two, other = (calibration_run(jax.random.key(seed), lidar, distances, 9)[0] for seed in (0, 0, 1))
    assert np.asarray(one).tobytes() == np.asarray(two).tobytes()
    assert not np.array_equal(one, other)
