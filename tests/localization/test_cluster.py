"""The heaviest cluster: its mean, covariance and share."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.localization import Clustering
from jaxslam.localization.cluster import heaviest_particle


def cloud(key, mean, deviations, count):
    offsets = jax.random.normal(key, (count, 3)) * jnp.asarray(deviations)[None]
    return jnp.asarray(mean)[None] + offsets


def test_moments_of_one_cluster():
    poses = cloud(jax.random.key(0), [3.0, -1.0, 0.4], [0.1, 0.05, 0.03], 20_000)
    found = Clustering().around(poses, jnp.full(20_000, 1 / 20_000), poses[0])
    np.testing.assert_allclose(found.mean, [3.0, -1.0, 0.4], atol=0.003)
    np.testing.assert_allclose(found.covariance, np.diag([0.01, 0.0025, 0.0009]), atol=3e-4)
    assert float(found.weight) == pytest.approx(1.0)
    assert float(found.deviation) == pytest.approx(np.hypot(0.1, 0.05), abs=0.002)


def test_the_other_cluster_does_not_pull():
    one = cloud(jax.random.key(0), [0.0, 0.0, 0.0], [0.1, 0.1, 0.05], 600)
    other = cloud(jax.random.key(1), [5.0, 0.0, 0.0], [0.1, 0.1, 0.05], 400)
    poses = jnp.concatenate([one, other])
    found = Clustering().around(poses, jnp.full(1000, 1e-3), one[3])
    np.testing.assert_allclose(found.mean, [0.0, 0.0, 0.0], atol=0.02)
    assert float(found.weight) == pytest.approx(0.6, abs=1e-4)


def test_opposite_headings_at_one_place_are_two_clusters():
    one = cloud(jax.random.key(0), [0.0, 0.0, 0.0], [0.05, 0.05, 0.02], 500)
    other = cloud(jax.random.key(1), [0.0, 0.0, np.pi], [0.05, 0.05, 0.02], 500)
    poses = jnp.concatenate([one, other])
    found = Clustering().around(poses, jnp.full(1000, 1e-3), other[0])
    assert abs(float(found.mean[2])) > 3.1
    assert float(found.weight) == pytest.approx(0.5, abs=1e-4)


def test_headings_across_pi():
    poses = cloud(jax.random.key(2), [0.0, 0.0, np.pi], [0.01, 0.01, 0.2], 5000)
    poses = poses.at[:, 2].set((poses[:, 2] + np.pi) % (2 * np.pi) - np.pi)
    found = Clustering().around(poses, jnp.full(5000, 1 / 5000), poses[0])
    assert abs(float(found.mean[2])) > 3.12
    assert float(found.covariance[2, 2]) < 0.05


def test_it_goes_to_where_the_weight_is():
    # From the edge of a cloud to its middle.
    poses = cloud(jax.random.key(3), [0.0, 0.0, 0.0], [0.4, 0.4, 0.02], 5000)
    found = Clustering().around(poses, jnp.full(5000, 1 / 5000), jnp.asarray([0.9, 0.9, 0.0]))
    np.testing.assert_allclose(found.mean[:2], [0.0, 0.0], atol=0.05)


def test_dead_particles_do_not_count():
    poses = jnp.asarray([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]])
    found = Clustering().around(poses, jnp.asarray([1.0, 0.0]), poses[0])
    np.testing.assert_allclose(found.mean, [0.0, 0.0, 0.0], atol=1e-7)


def test_without_weight_it_stays_finite():
    found = Clustering().around(jnp.zeros((3, 3)), jnp.zeros(3), jnp.ones(3))
    assert bool(jnp.all(jnp.isfinite(found.mean)))
    assert float(found.weight) == 0.0


def test_the_start_is_where_most_of_the_weight_is_and_not_the_heaviest_particle():
    poses = jnp.asarray([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.2, 0.0, 0.0], [9.0, 0.0, 0.0]])
    weights = jnp.asarray([0.2, 0.22, 0.2, 0.38])
    found = heaviest_particle(poses, weights, jnp.asarray([0, 0, 0, 2], jnp.int32), 3)
    np.testing.assert_allclose(found, poses[1])
