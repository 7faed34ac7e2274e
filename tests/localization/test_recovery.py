"""The share of random particles, by hand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.localization import Averages, Recovery

BOOK = Recovery(slow=0.1, fast=0.5, root=1.0, drop=1.0)


def run(recovery, likelihoods):
    averages = Averages.none()
    shares = []
    for value in likelihoods:
        averages = recovery.update(averages, jnp.float32(value))
        shares.append(float(recovery.share(averages)))
    return averages, shares


def test_nothing_before_the_first_scan_and_while_all_is_well():
    assert float(BOOK.share(Averages.none())) == 0.0
    _, shares = run(BOOK, [0.8] * 30)
    np.testing.assert_allclose(shares, 0.0, atol=1e-6)


def test_table_8_3_by_hand():
    # Long at 0.8: both averages are there. Then 0.2: slow 0.74, fast 0.5, share 1 − 0.5 / 0.74.
    _, shares = run(BOOK, [0.8] * 400 + [0.2])
    assert shares[-1] == pytest.approx(1 - 0.5 / 0.74, abs=1e-5)


def test_the_first_averages_are_plain_means():
    averages, _ = run(Recovery(slow=1e-4, fast=0.5, root=1.0, drop=1.0), [0.2, 0.4, 0.6])
    assert float(averages.slow / averages.slow_weight) == pytest.approx(0.4, abs=1e-4)


def test_getting_better_is_no_kidnapping():
    _, shares = run(BOOK, [0.01] * 5 + [0.9] * 5)
    assert max(shares) < 1e-6


def test_the_root_is_of_one_beam():
    # A likelihood of ten beams that count: 0.5 each instead of 0.8.
    _, of_one = run(BOOK, [0.8] * 400 + [0.5])
    rooted = Recovery(slow=0.1, fast=0.5, root=10.0, drop=1.0)
    _, of_ten = run(rooted, [0.8**10] * 400 + [0.5**10])
    assert of_ten[-1] == pytest.approx(of_one[-1], abs=1e-5)


def test_a_small_drop_is_let_pass():
    lenient = Recovery(slow=0.1, fast=0.5, root=1.0, drop=0.6)
    _, shares = run(lenient, [0.8] * 400 + [0.6] * 3)
    assert max(shares) == 0.0
    _, shares = run(lenient, [0.8] * 400 + [0.1] * 3)
    assert shares[-1] > 0.3


@pytest.mark.parametrize("value", [np.nan, np.inf, 0.0])
def test_what_is_no_likelihood_counts_as_none(value):
    _, shares = run(BOOK, [0.8] * 10 + [value])
    assert 0.0 < shares[-1] <= 1.0


def test_switched_off():
    _, shares = run(Recovery(slow=0.0), [0.8] * 10 + [0.0] * 10)
    assert max(shares) == 0.0


def test_it_can_be_traced():
    def share(slow):
        recovery = Recovery(slow, 0.5, 1.0, 1.0)
        averages = recovery.update(recovery.update(Averages.none(), jnp.float32(0.8)), jnp.float32(0.1))
        return recovery.share(averages)

    shares = jax.vmap(share)(jnp.asarray([0.0, 0.1]))
    assert float(shares[0]) == 0.0
    assert float(shares[1]) == pytest.approx(0.226, abs=0.01)


def test_bad_settings_are_refused():
    with pytest.raises(ValueError, match="slow < fast"):
        Recovery(slow=0.3, fast=0.2)
