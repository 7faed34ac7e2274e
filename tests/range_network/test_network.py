"""The network alone: how it begins, what it computes, and what it leaves as it is."""

import chex
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.range_network import RangeNetwork
from tests.builders import scan_of

SHORTEST, LONGEST = 0.12, 3.5


@pytest.fixture(scope="module")
def network() -> RangeNetwork:
    """One that corrects by centimeters, as a trained one would, and not by the same at its two ends."""
    drawn = RangeNetwork.draw(jax.random.key(1), 20, SHORTEST, LONGEST)
    noise = 0.05 * jax.random.normal(jax.random.key(2), (20,))
    bent = eqx.tree_at(lambda n: n.weights_out, drawn, drawn.weights_out + noise)
    assert (np.abs(corrections(bent, [SHORTEST, 1.0, LONGEST])) > 0.005).all()
    return bent


def by_hand(bias_out=0.1) -> RangeNetwork:
    """One neuron, between 1 m and 3 m."""
    values = jnp.array([2.0]), jnp.array([0.5]), jnp.array([0.8])
    return RangeNetwork(*values, *(jnp.asarray(value, jnp.float32) for value in (bias_out, 1.0, 3.0)))


def corrections(network: RangeNetwork, ranges) -> np.ndarray:
    ranges = jnp.asarray(ranges, jnp.float32)
    return np.asarray(network(ranges)) - np.asarray(ranges)


def test_one_neuron_by_hand():
    # 2.25 m is 0.25 of the way from the middle to the end; tanh(2 · 0.25 + 0.5) = 0.7615942, so
    # 0.8 · 0.7615942 + 0.1 = 0.7092753 of the way come out, which is 2.7092753 m.
    assert float(by_hand()(jnp.asarray(2.25))) == pytest.approx(2.7092753, abs=1e-6)
    # The ends: tanh(−1.5) = −0.9051483 and tanh(2.5) = 0.9866143.
    np.testing.assert_allclose(by_hand()(jnp.array([1.0, 3.0])), [1.3758814, 2.8892914], atol=1e-6)


@pytest.mark.parametrize(
    ("num_neurons", "share"),
    # 1.5 times the largest correction of 200 keys, as a share of the interval: 6.4, 0.58, 0.27 and 0.15 %.
    [(5, 0.097), (20, 0.0087), (50, 0.0041), (200, 0.0022)],
)
@pytest.mark.parametrize("interval", [(SHORTEST, LONGEST), (10.0, 80.0)], ids=str)
def test_a_new_network_corrects_nearly_nothing(num_neurons, share, interval):
    ranges = jnp.linspace(*interval, 500)

    def largest(key):
        return jnp.abs(RangeNetwork.draw(key, num_neurons, *interval)(ranges) - ranges).max()

    corrected = jax.vmap(largest)(jax.random.split(jax.random.key(0), 40))
    assert corrected.max() < share * (interval[1] - interval[0])


def test_neurons_switch_all_over_the_interval():
    network = RangeNetwork.draw(jax.random.key(0), 50, SHORTEST, LONGEST)
    assert network.num_neurons == 50
    # Where the input of the tanh is zero, in −1 to 1: each neuron has a fiftieth of it to itself.
    where = -np.asarray(network.biases) / np.asarray(network.weights_in)
    np.testing.assert_array_equal(np.floor((where + 1) * 25), np.arange(50))
    assert 1.0 <= network.weights_in.min() <= network.weights_in.max() <= 4.0


def test_the_correction_of_the_ends_is_held_beyond_them(network):
    near, far = [0.0, 0.01, 0.1199], [3.5001, 4.0, 80.0, 1e6]
    for end, beyond in [(SHORTEST, near), (LONGEST, far)]:
        held = corrections(network, [end])[0]
        ranges = np.asarray(beyond, np.float32)
        # The same but for rounding: one and several at a time are compiled apart.
        corrected = np.asarray(network(jnp.asarray(ranges)))
        np.testing.assert_allclose(corrected, ranges + held, rtol=1e-6, atol=1e-6)


def test_invalid_beams_stay_as_they_are(network):
    ranges = [1.0, 0.0, 2.0, 9.5, np.inf, np.nan]
    scan = scan_of(ranges, [True, False, True, False, False, False])
    corrected = network.correct(scan)
    np.testing.assert_array_equal(corrected.valid, scan.valid)
    np.testing.assert_array_equal(
        np.asarray(corrected.ranges)[[1, 3, 4, 5]], np.float32(ranges)[[1, 3, 4, 5]]
    )
    expected = network(jnp.array([1.0, 2.0]))
    np.testing.assert_allclose(corrected.ranges[scan.valid], expected, rtol=1e-6)
    assert (np.abs(expected - jnp.array([1.0, 2.0])) > 0.001).all()
    for name in ("angle_min", "angle_increment", "pose_base_lidar"):
        np.testing.assert_array_equal(getattr(corrected, name), getattr(scan, name))


def test_no_range_becomes_negative():
    # Its short end is corrected by 1.3758814 − 1 − 3.1 m.
    network = by_hand(bias_out=-3.0)
    corrected = network.correct(scan_of([0.5, 1.0, 3.0, 6.0], [True] * 4))
    assert (corrections(network, [0.5, 1.0])[:2] < -2.0).all()
    np.testing.assert_array_equal(corrected.ranges[:3], 0.0)
    assert float(corrected.ranges[3]) == pytest.approx(6.0 + 2.8892914 - 3.0 - 3.1, abs=1e-5)


def test_vmap_and_jit_compute_the_same(network):
    ranges = jnp.linspace(0.0, 4.0, 60).reshape(3, 4, 5)
    plain = np.asarray(network(ranges))
    assert plain.shape == (3, 4, 5)
    for other in (
        jax.jit(lambda n, r: n(r))(network, ranges),
        jax.vmap(jax.vmap(network))(ranges),
        jnp.stack([network(value) for value in ranges.ravel()]).reshape(ranges.shape),
    ):
        # A meter in float32 is 1e-7 m; twenty summands.
        np.testing.assert_allclose(other, plain, atol=1e-5)


def test_a_stack_of_scans_is_corrected_scan_by_scan(network):
    scans = [scan_of(np.linspace(0.0, 3.0, 6) + shift, np.arange(6) > 0) for shift in (0.0, 0.7)]
    stacked = network.correct(jax.tree.map(lambda *leaves: jnp.stack(leaves), *scans))
    for index, scan in enumerate(scans):
        np.testing.assert_allclose(stacked.ranges[index], network.correct(scan).ranges, atol=1e-6)


@pytest.mark.parametrize("num_neurons", [0, -3])
def test_sizes_that_make_no_network_are_refused(num_neurons):
    with pytest.raises(ValueError, match=f"num_neurons is {num_neurons}: give 1 or more"):
        RangeNetwork.draw(jax.random.key(0), num_neurons, SHORTEST, LONGEST)


@pytest.mark.parametrize("interval", [(1.0, 1.0), (2.0, 1.0), (float("nan"), 1.0), (0.0, float("nan"))])
def test_intervals_that_are_none_are_refused(interval):
    with pytest.raises(ValueError, match=r"ranges from .* to .* m: give a longest above the shortest"):
        RangeNetwork.draw(jax.random.key(0), 5, *interval)


def test_gradients_are_finite(network):
    """At the ends, beyond them, and where nothing came back."""
    ranges = jnp.array([0.0, SHORTEST, 1.0, LONGEST, 9.0])
    scan = scan_of(ranges, [False, True, True, True, True])

    def loss(network, ranges):
        corrected = network.correct(eqx.tree_at(lambda s: s.ranges, scan, ranges))
        return jnp.sum((corrected.ranges - 1.0) ** 2)

    of_network, of_ranges = jax.grad(loss, argnums=(0, 1))(network, ranges)
    chex.assert_tree_all_finite((of_network, of_ranges))
    assert np.abs(of_network.weights_out).min() > 0
    # Beyond the interval the correction is constant: 2 · (corrected − 1) · 1.
    beyond = float(network(jnp.asarray(9.0)))
    assert float(of_ranges[4]) == pytest.approx(2 * (beyond - 1.0), rel=1e-5)
