"""Sensor models on known maps: values by hand, rotated maps, beam skipping."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.grid.known_map import KnownMap
from jaxslam.localization import BeamSkipping
from jaxslam.sensor import LikelihoodField, Nav2Field
from jaxslam.sensor.beam import Beam
from tests import builders
from tests.builders import room

YES, NO = jnp.asarray(True), jnp.asarray(False)
# Beams to the right, ahead and to the left unless said otherwise.
scan_of = functools.partial(builders.scan_of, angle_min=-np.pi / 2, increment=np.pi / 2)


def field_model(**settings):
    """A likelihood field as localization uses it."""
    return LikelihoodField(
        **{"sigma_hit": 0.2, "unseen_beams": 0.0, "independent_beams": 5.0, "max_beams": 60, **settings}
    )


def log_likelihood(model, map, scan, pose):
    poses = map.to_map(jnp.asarray([pose], jnp.float32))
    return float(model.log_prob_all(model.prepare(map), scan, poses)[0])


def skip(skipping, map, scan, pose, converged):
    poses = map.to_map(jnp.asarray([pose], jnp.float32))
    return skipping.skip(map, scan, poses, jnp.ones(1, bool), converged, 60)


def beam(distance, sigma=0.2, z_hit=0.95, z_rand=0.05):
    return (z_hit * np.exp(-0.5 * (distance / sigma) ** 2) + z_rand) / (z_hit + z_rand)


# In the middle of cell (2, 2); walls are cells 0 and 7 along x, 0 and 5 along y.
POSE = (1.25, 1.25, 0.0)


def test_product_by_hand():
    known = KnownMap.from_map(room())
    model = field_model(sigma_hit=0.5, independent_beams=2.0)
    # Ahead into the wall cell (7), right half a meter short of its wall (0), left in the room's middle.
    scan = scan_of([0.5, 2.5, 0.5])
    expected = np.log([beam(0.5, 0.5), beam(0.0, 0.5), beam(1.0, 0.5)]).mean() * 2.0
    assert log_likelihood(model, known, scan, POSE) == pytest.approx(expected, rel=1e-4)


def test_cubes_by_hand():
    known = KnownMap.from_map(room())
    model = Nav2Field(sigma_hit=0.5, z_hit=0.5, z_rand=0.5, max_range=10.0)
    each = [0.5 * np.exp(-0.5 * (d / 0.5) ** 2) + 0.05 for d in (0.5, 0.0, 1.0)]
    expected = np.log(1 + np.sum(np.power(each, 3)))
    assert log_likelihood(model, known, scan_of([0.5, 2.5, 0.5]), POSE) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("origin", [(3.0, -7.0, 0.0), (0.0, 0.0, 1.1), (-4.0, 2.0, -2.5)])
@pytest.mark.parametrize("model", [field_model(), Nav2Field(), Beam(10.0)])
def test_map_and_robot_moved_together_change_nothing(origin, model):
    from jaxslam.core import se2

    scan = scan_of([0.9, 2.2, 1.1], mounting=(0.1, -0.05, 0.2))
    here = log_likelihood(model, KnownMap.from_map(room()), scan, POSE)
    moved = se2.compose(jnp.asarray(origin, jnp.float32), jnp.asarray(POSE, jnp.float32))
    there = log_likelihood(model, KnownMap.from_map(room(origin=origin)), scan, moved)
    assert there == pytest.approx(here, rel=1e-3, abs=1e-4)


@pytest.mark.parametrize("model", [field_model(), Nav2Field(), Beam(10.0)])
def test_the_right_place_is_the_likeliest(model):
    known = KnownMap.from_map(room())
    scan = scan_of([1.0, 2.5, 1.5])
    right = log_likelihood(model, known, scan, POSE)
    assert right > log_likelihood(model, known, scan, (2.25, 1.25, 0.0))
    assert right > log_likelihood(model, known, scan, (1.25, 1.25, np.pi))


def test_beams_off_the_map_and_odd_poses_are_harmless():
    known = KnownMap.from_map(room())
    far = log_likelihood(field_model(independent_beams=1.0), known, scan_of([500.0, 500.0, 500.0]), POSE)
    assert far == pytest.approx(np.log(0.05), rel=1e-3)
    for pose in [(1e6, -1e6, 0.0), (np.nan, 1.0, 0.0), (1.0, np.inf, 0.0), (1.0, 1.0, np.nan)]:
        # All beams end on the border, far from all.
        found = log_likelihood(field_model(independent_beams=3.0), known, scan_of([1.0, 2.5, 1.5]), pose)
        assert found == pytest.approx(3 * np.log(0.05), rel=1e-3)


def test_a_scan_without_a_return_says_nothing():
    known = KnownMap.from_map(room())
    assert log_likelihood(field_model(), known, scan_of([0.0, 0.0, 0.0]), POSE) == 0.0


def test_more_beams_do_not_make_a_scan_say_more():
    known = KnownMap.from_map(room())
    angles = np.linspace(-0.2, 0.2, 61)
    scan = scan_of(np.full(61, 2.0), angle_min=angles[0], increment=angles[1] - angles[0])
    few, many = (
        log_likelihood(field_model(max_beams=n, independent_beams=5.0), known, scan, POSE) for n in (5, 61)
    )
    assert few == pytest.approx(many, rel=0.05)


def test_a_beam_never_counts_for_more_than_one():
    known = KnownMap.from_map(room())
    model = field_model(sigma_hit=0.5, independent_beams=10.0)
    found = log_likelihood(model, known, scan_of([0.5, 0.0, 0.0]), POSE)
    assert found == pytest.approx(np.log(beam(0.5, 0.5)), rel=1e-4)


def test_beams_that_are_not_looked_at_are_not_counted():
    scan = scan_of([0.0, 1.0, 0.0, 1.0, 0.0])
    assert float(field_model(max_beams=3).num_scored(scan)) == 0.0
    assert float(field_model(max_beams=5).num_scored(scan)) == 2.0


@pytest.mark.parametrize("model", [field_model(sigma_hit=0.5, independent_beams=1.0), Beam(10.0)])
def test_a_lidar_off_the_center_sees_from_where_it_is(model):
    """Half a meter ahead on the robot and turned left: its beam ahead is one to the robot's left."""
    known = KnownMap.from_map(room())
    mounted = scan_of([1.5], angle_min=0.0, mounting=(0.5, 0.0, np.pi / 2))
    there = scan_of([1.5], angle_min=0.0)
    expected = log_likelihood(model, known, there, (POSE[0] + 0.5, POSE[1], np.pi / 2))
    assert log_likelihood(model, known, mounted, POSE) == pytest.approx(expected, abs=1e-4)
    elsewhere = log_likelihood(model, known, mounted, (*POSE[:2], -np.pi / 2))
    assert elsewhere < expected - 0.1


def test_skipping_leaves_out_what_nobody_explains():
    skipping = BeamSkipping(near=0.5, min_share=0.3, max_skipped=0.9, enabled=True)
    shares = jnp.asarray([0.9, 0.1, 0.4, 0.0])
    valid = jnp.asarray([True, True, True, False])
    np.testing.assert_array_equal(skipping.kept(shares, valid, YES), [True, False, True, False])
    # Not before the particles agree, and not where nearly nothing would be left.
    np.testing.assert_array_equal(skipping.kept(shares, valid, NO), valid)
    np.testing.assert_array_equal(skipping.kept(0.1 * shares, valid, YES), valid)


def test_skipping_takes_a_passer_by_out_of_the_score():
    known = KnownMap.from_map(room())
    clean, disturbed = scan_of([1.0, 2.5, 1.5]), scan_of([1.0, 0.9, 1.5])
    skipping, model = BeamSkipping(near=0.4, enabled=True), field_model()
    kept = skip(skipping, known, disturbed, POSE, YES)
    np.testing.assert_array_equal(kept.valid, [True, False, True])
    score = log_likelihood(model, known, kept, POSE)
    assert score == pytest.approx(log_likelihood(model, known, clean, POSE), abs=1e-4)
    assert log_likelihood(model, known, disturbed, POSE) < score - 1.0
    assert skip(skipping, known, disturbed, POSE, NO).valid.all()


def test_the_sum_over_beams_is_that_of_single_look_ups():
    known = KnownMap.from_map(room())
    model = field_model(independent_beams=7.0)
    table = np.asarray(model.prepare(known).values).reshape(8, 10)
    scan = scan_of(np.linspace(0.2, 3.0, 7), angle_min=-1.5, increment=0.5)
    poses = np.random.default_rng(0).uniform([0.6, 0.6, -3], [3.4, 2.4, 3], (50, 3)).astype(np.float32)
    found = jax.jit(lambda p: model.log_prob_all(model.prepare(known), scan, p))(poses)
    angles = poses[:, 2:] + (-1.5 + 0.5 * np.arange(7))
    x = poses[:, :1] + np.linspace(0.2, 3.0, 7) * np.cos(angles)
    y = poses[:, 1:2] + np.linspace(0.2, 3.0, 7) * np.sin(angles)
    column = np.clip(np.floor(x / 0.5 + 1), 0, 9).astype(int)
    row = np.clip(np.floor(y / 0.5 + 1), 0, 7).astype(int)
    np.testing.assert_allclose(found, table[row, column].mean(axis=1) * 7.0, rtol=1e-4)


def test_bad_settings_are_refused():
    for model in (LikelihoodField, Nav2Field):
        with pytest.raises(ValueError, match="sigma_hit"):
            model(sigma_hit=0.0)
