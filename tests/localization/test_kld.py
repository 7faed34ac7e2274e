"""Fox' bound by hand, the number of particles for a known histogram, bins."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import chi2, norm

from jaxslam.grid.known_map import KnownMap
from jaxslam.localization import Bins, KLDSampling
from tests.builders import room

SAMPLING = KLDSampling(error=0.05, quantile=2.326, min_particles=2.0)


def bound_by_hand(bins, error=0.05, quantile=2.326):
    a = 2 / (9 * (bins - 1))
    return int(np.ceil((bins - 1) / (2 * error) * (1 - a + np.sqrt(a) * quantile) ** 3))


def test_bound_is_foxs():
    # Two of them written out: (13) of the paper with k = 2 and k = 10.
    assert bound_by_hand(2) == 66
    assert bound_by_hand(10) == 217
    counts = np.array([2, 3, 10, 100, 5000])
    expected = [bound_by_hand(k) for k in counts]
    np.testing.assert_array_equal(SAMPLING.bound(jnp.asarray(counts)), expected)


def test_bound_is_the_chi_square_quantile_that_it_approximates():
    for bins in (10, 100, 1000):
        exact = chi2.ppf(norm.cdf(2.326), bins - 1) / (2 * 0.05)
        assert float(SAMPLING.bound(jnp.asarray(bins))) == pytest.approx(exact, rel=0.01)


def test_one_bin_needs_the_least():
    sampling = KLDSampling(min_particles=20.0)
    assert float(sampling.bound(jnp.asarray(1))) == 20
    assert int(sampling.num_needed(jnp.zeros(1000, jnp.int32), 4)) == 20


@pytest.mark.parametrize("num_bins", [2, 7, 30])
def test_particles_for_a_known_histogram(num_bins):
    # All bins are seen in the first round, so the bound is that of all of them.
    bins = jnp.arange(5000, dtype=jnp.int32) % num_bins
    assert int(SAMPLING.num_needed(bins, num_bins)) == max(bound_by_hand(num_bins), num_bins)


def test_a_late_bin_counts_from_when_it_is_seen():
    bins = jnp.arange(5000, dtype=jnp.int32) % 2
    # Two bins ask for 66 ...
    assert int(SAMPLING.num_needed(bins, 4)) == 66
    # ... a third one just before that for as many as three do, and one after it comes too late.
    assert int(SAMPLING.num_needed(bins.at[65].set(2), 4)) == bound_by_hand(3)
    assert int(SAMPLING.num_needed(bins.at[66].set(2), 4)) == 66


def test_all_of_them_where_they_are_not_enough():
    assert int(SAMPLING.num_needed(jnp.arange(300, dtype=jnp.int32), 300)) == 300


def test_bins_tell_places_and_headings_apart():
    known = KnownMap.from_map(room())
    bins = Bins.over(known, 1.0, np.pi / 2)
    assert (bins.columns, bins.rows, bins.num_headings) == (4, 3, 4)
    poses = jnp.asarray([[0.1, 0.1, 0.1], [0.9, 0.9, 1.5], [1.1, 0.1, 0.1], [0.1, 1.1, 0.1], [0.1, 0.1, 1.6]])
    index = np.asarray(bins.index(known, poses))
    assert index[0] == index[1]
    assert len(set(index[[0, 2, 3, 4]])) == 4
    # Headings a whole turn apart are one; what lies off the map counts at its edge.
    same = jnp.asarray([[0.1, 0.1, 0.1 - 2 * np.pi], [-5.0, -5.0, 0.1], [np.nan, 0.1, 0.1]])
    found = np.asarray(bins.index(known, same))
    assert (found[:2] == index[0]).all()
    assert 0 <= found[2] < bins.count


def test_bound_can_be_traced():
    errors = jnp.asarray([0.02, 0.05])
    found = jax.vmap(lambda error: KLDSampling(error, 2.326, 1.0).bound(jnp.asarray(10)))(errors)
    np.testing.assert_array_equal(found, [bound_by_hand(10, 0.02), bound_by_hand(10, 0.05)])


def test_bad_settings_are_refused():
    with pytest.raises(ValueError, match="error"):
        KLDSampling(error=0.0)
