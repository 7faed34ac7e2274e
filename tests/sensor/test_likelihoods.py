"""Likelihoods computed by hand on 5 × 5 maps, and the same with the map moved and turned."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.sensor import Beam, Endpoint, LikelihoodField
from tests import builders

# A beam ahead and one to the left.
scan_of = functools.partial(builders.scan_of, increment=np.pi / 2)
POSE = (0.25, 0.25, 0.0)


def field_of(cells, origin=(0.0, 0.0)):
    """A 5 × 5 map with the (row, column) cells occupied."""
    occupied = np.zeros((5, 5), bool)
    for row, column in cells:
        occupied[row, column] = True
    return builders.field_of(occupied, origin, radius=3)


@jax.jit
def log_prob(model, field, scan, pose):
    return model.log_prob(field, scan, pose)


def value(model, field, scan, pose=POSE):
    return float(log_prob(model, field, scan, jnp.asarray(pose, jnp.float32)))


# (map, ranges of the beams ahead and to the left, expected) for σ = 0.1 and a scan counting as one beam.
LIKELIHOOD_FIELD = LikelihoodField(0.1, z_hit=0.9, z_rand=0.1, unseen_beams=0.0, independent_beams=1.0)
LIKELIHOOD_FIELD_CASES = {
    "on the obstacle": ([(2, 4)], [0.2, 0.0], 0.0),
    "one cell short": ([(2, 4)], [0.1, 0.0], np.log(0.9 * np.exp(-0.5) + 0.1)),
    "one cell across": ([(2, 4), (4, 1)], [0.2, 0.2], 0.5 * np.log(0.9 * np.exp(-0.5) + 0.1)),
    # Nothing near: the truncated distance, √10 cells for a radius of 3.
    "nothing near": ([], [0.1, 0.2], np.log(0.9 * np.exp(-5.0) + 0.1)),
}


@pytest.mark.parametrize("case", LIKELIHOOD_FIELD_CASES.values(), ids=LIKELIHOOD_FIELD_CASES.keys())
def test_likelihood_field_by_hand(case):
    cells, ranges, expected = case
    assert value(LIKELIHOOD_FIELD, field_of(cells), scan_of(ranges)) == pytest.approx(expected, abs=1e-5)


def test_likelihood_field_counts_a_scan_as_so_many_beams():
    threefold = LikelihoodField(0.1, z_hit=0.9, z_rand=0.1, unseen_beams=0.0, independent_beams=3.0)
    assert value(threefold, field_of([(2, 4)]), scan_of([0.1, 0.0])) == pytest.approx(
        3 * np.log(0.9 * np.exp(-0.5) + 0.1), abs=1e-5
    )


def test_likelihood_field_without_a_beam_tells_nothing():
    assert value(LIKELIHOOD_FIELD, field_of([(2, 4)]), scan_of([0.0, 0.0])) == 0.0
    # One beam of the density `z_unseen` beside one a cell short.
    doubtful = LikelihoodField(
        0.1, z_hit=0.9, z_rand=0.1, z_unseen=0.5, unseen_beams=1.0, independent_beams=1.0
    )
    assert value(doubtful, field_of([(2, 4)]), scan_of([0.1, 0.0])) == pytest.approx(
        0.5 * (np.log(0.9 * np.exp(-0.5) + 0.1) + np.log(0.5)), abs=1e-5
    )


ENDPOINT = Endpoint(sigma_hit=0.1, log_miss=-3.0, beam_weight=1.0)
ENDPOINT_CASES = {
    "on the obstacle": ([(2, 4)], [0.2, 0.0], 0.0),
    "3 cm before its center": ([(2, 4)], [0.17, 0.0], -0.5 * 0.3**2),
    "one cell short": ([(2, 4)], [0.1, 0.0], -0.5),
    # Both are next to the end; the nearer one counts.
    "nearest of two": ([(2, 4), (1, 3)], [0.14, 0.0], -0.5 * 0.6**2),
    "out of the kernel": ([(2, 4)], [0.03, 0.0], -3.0),
    # The cell before the obstacle is occupied too: it was seen through a wall, while the wall itself is far.
    "behind a wall's face": ([(4, 2), (3, 2), (2, 2)], [0.0, 0.2], -3.0),
}


@pytest.mark.parametrize("case", ENDPOINT_CASES.values(), ids=ENDPOINT_CASES.keys())
def test_endpoint_by_hand(case):
    cells, ranges, expected = case
    assert value(ENDPOINT, field_of(cells), scan_of(ranges)) == pytest.approx(expected, abs=1e-5)


def test_endpoint_sees_a_wall_from_its_front_only():
    wall = field_of([(4, 0), (4, 1), (4, 2), (4, 3), (4, 4), (3, 0), (3, 1), (3, 2), (3, 3), (3, 4)])
    # From below the end 2 cm into the face (row 3) belongs to it; 12 cm in, the face is one cell before.
    assert value(ENDPOINT, wall, scan_of([0.0, 0.12])) == pytest.approx(-0.5 * 0.2**2, abs=1e-5)
    assert value(ENDPOINT, wall, scan_of([0.0, 0.22])) == pytest.approx(-0.5 * 1.2**2, abs=1e-5)
    # The likelihood field does not know the difference: the end lies in an occupied cell.
    assert value(LIKELIHOOD_FIELD, wall, scan_of([0.0, 0.22])) == pytest.approx(0.0, abs=0.02)


def test_endpoint_with_a_kernel_of_one_cell_looks_at_the_end_only():
    alone = Endpoint(sigma_hit=0.1, log_miss=-3.0, beam_weight=1.0, kernel=0)
    assert value(alone, field_of([(2, 4)]), scan_of([0.17, 0.0])) == pytest.approx(-0.045, abs=1e-5)
    assert value(alone, field_of([(2, 4)]), scan_of([0.1, 0.0])) == -3.0
    with pytest.raises(ValueError, match="kernel is -1 cells"):
        Endpoint(kernel=-1)


BEAM = Beam(10.0, 0.1, z_hit=0.8, z_short=0.05, z_max=0.05, z_rand=0.1, lambda_short=0.1, beam_weight=1.0)


def test_beam_by_hand():
    found = BEAM.log_density(jnp.asarray([2.0, 1.0, 5.0]), jnp.asarray([2.0, 2.0, 2.0]))
    # 0.8 / (0.1 √2π) + 0.05 · 0.1 e^−0.2 / (1 − e^−0.2) + 0.1 / 10; then without the first; then the last.
    np.testing.assert_allclose(found, [1.17066, -3.35360, -4.60517], atol=1e-4)
    # 20 cells of 0.1 m would be 2 m; here 0.15 m to the face of the cell two on, and half a cell more.
    expected = float(BEAM.log_density(jnp.asarray([0.2]), jnp.asarray([0.2]))[0])
    assert value(BEAM, field_of([(2, 4)]), scan_of([0.2, 0.0])) == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize("expected", [0.02, 0.3, 2.0, 9.95, 10.0])
def test_beam_density_and_mass_add_up_to_one(expected):
    step = 1e-4
    ranges = np.arange(0.0, 10.0, step) + 0.5 * step
    density = jax.jit(BEAM.log_density)(
        jnp.asarray(ranges, jnp.float32), jnp.full(len(ranges), expected, jnp.float32)
    )
    mass = np.exp(np.asarray(density, np.float64)).sum() * step
    # The mid-point rule is exact to 1e-7 here but for the jump at `expected`, step · 50 / m at most.
    assert mass + 0.05 == pytest.approx(1.0, abs=2e-3)


def test_beam_weights_need_not_add_up_to_one():
    doubled = Beam(10.0, 0.1, z_hit=1.6, z_short=0.1, z_max=0.1, z_rand=0.2, lambda_short=0.1)
    ranges, expected = jnp.asarray([0.5, 2.0, 2.1]), jnp.asarray([2.0, 2.0, 2.0])
    np.testing.assert_allclose(doubled.log_density(ranges, expected), BEAM.log_density(ranges, expected))


def test_beam_over_its_maximum_is_no_return():
    short_sighted = Beam(0.2, beam_weight=1.0)
    assert value(short_sighted, field_of([(2, 4)]), scan_of([0.2, 0.3])) == 0.0


@pytest.mark.parametrize(
    ("name", "bad"),
    [("max_range", 0.0), ("sigma_hit", -0.1), ("z_rand", 0.0), ("lambda_short", float("nan"))],
)
def test_beam_refuses_what_makes_no_density(name, bad):
    with pytest.raises(ValueError, match=f"Beam: {name} is {bad}, must be > 0"):
        Beam(**{"max_range": 10.0, name: bad})


@pytest.mark.parametrize("model", [LIKELIHOOD_FIELD, ENDPOINT, BEAM], ids=["field", "endpoint", "beam"])
def test_a_moved_map_and_a_turned_robot_give_the_same(model):
    cells, scan = [(2, 4), (4, 1)], scan_of([0.17, 0.21])
    here = value(model, field_of(cells), scan)
    moved = field_of(cells, origin=(-3.0, 6.0))
    assert value(model, moved, scan, (-2.75, 6.25, 0.0)) == pytest.approx(here, abs=1e-4)
    # A quarter turn to the left, with the map turned alike: (row, column) becomes (column, 4 − row).
    turned = field_of([(column, 4 - row) for row, column in cells])
    assert value(model, turned, scan, (0.25, 0.25, np.pi / 2)) == pytest.approx(here, abs=1e-4)
    # The lidar turned on the robot instead, and off its center.
    mounted = scan_of([0.17, 0.21], mounting=(0.1, 0.0, np.pi / 2))
    assert value(model, turned, mounted, (0.15, 0.25, 0.0)) == pytest.approx(here, abs=1e-4)
