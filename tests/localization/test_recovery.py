"""The share of random particles, by hand."""

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.localization import Averages, Recovery

BOOK = Recovery(slow=0.1, fast=0.5, drop=1.0)


YES, NO = jnp.asarray(True), jnp.asarray(False)


def run(recovery, likelihoods, misfit=NO, lost=NO):
    averages = Averages.none()
    shares = []
    for value in likelihoods:
        averages = recovery.update(averages, jnp.log(jnp.float32(value)), misfit)
        shares.append(float(recovery.share(averages, lost)))
    return averages, shares


def test_nothing_before_the_first_scan_and_while_all_is_well():
    assert float(BOOK.share(Averages.none(), NO)) == 0.0
    _, shares = run(BOOK, [0.8] * 30)
    np.testing.assert_allclose(shares, 0.0, atol=1e-6)


def test_table_8_3_by_hand():
    # Long at 0.8: both averages are there. Then 0.2: slow 0.74, fast 0.5, share 1 − 0.5 / 0.74.
    _, shares = run(BOOK, [0.8] * 400 + [0.2])
    assert shares[-1] == pytest.approx(1 - 0.5 / 0.74, abs=1e-5)


def test_the_first_averages_are_plain_means():
    averages, _ = run(Recovery(slow=1e-4, fast=0.5, drop=1.0), [0.2, 0.4, 0.6])
    assert float(averages.slow / averages.slow_weight) == pytest.approx(0.4, abs=1e-4)


def test_getting_better_is_no_kidnapping():
    _, shares = run(BOOK, [0.01] * 5 + [0.9] * 5)
    assert max(shares) < 1e-6


def test_the_slow_average_waits_while_the_scan_does_not_lie_on_the_map():
    averages, _ = run(BOOK, [0.8] * 400)
    for _ in range(500):
        averages = BOOK.update(averages, jnp.log(jnp.float32(0.2)), YES)
    # The book's would be at 0.2, and ask for no random particles any more.
    assert float(BOOK.share(averages, NO)) == pytest.approx(1 - 0.2 / 0.8, abs=1e-4)


def test_some_are_random_while_lost_however_long():
    recovery = Recovery(slow=0.1, fast=0.5, drop=1.0, lost_share=0.07)
    _, shares = run(recovery, [0.2] * 300, lost=YES)
    assert shares[-1] == pytest.approx(0.07)
    _, shares = run(Recovery(slow=0.0, lost_share=0.07), [0.2] * 3, lost=YES)
    assert shares[-1] == 0.0


def test_a_small_drop_is_let_pass():
    lenient = Recovery(slow=0.1, fast=0.5, drop=0.6)
    _, shares = run(lenient, [0.8] * 400 + [0.6] * 3)
    assert max(shares) == 0.0
    _, shares = run(lenient, [0.8] * 400 + [0.1] * 3)
    assert shares[-1] > 0.3


def test_a_scan_that_nothing_fits_is_data():
    _, shares = run(BOOK, [0.8] * 400 + [0.0])
    assert shares[-1] == pytest.approx(1 - 0.4 / 0.72, abs=1e-5)


def test_a_likelihood_that_is_no_number_changes_nothing():
    averages, _ = run(BOOK, [0.8] * 10)
    after = BOOK.update(averages, jnp.float32(np.nan), NO)
    chex.assert_trees_all_equal(after, averages)


def test_switched_off():
    _, shares = run(Recovery(slow=0.0), [0.8] * 10 + [0.0] * 10)
    assert max(shares) == 0.0


def test_it_can_be_traced():
    def share(slow):
        recovery = Recovery(slow, 0.5, 1.0)
        averages = recovery.update(Averages.none(), jnp.log(jnp.float32(0.8)), NO)
        return recovery.share(recovery.update(averages, jnp.log(jnp.float32(0.1)), NO), NO)

    shares = jax.vmap(share)(jnp.asarray([0.0, 0.1]))
    assert float(shares[0]) == 0.0
    assert float(shares[1]) == pytest.approx(0.226, abs=0.01)


def test_bad_settings_are_refused():
    with pytest.raises(ValueError, match="slow < fast"):
        Recovery(slow=0.3, fast=0.2)
