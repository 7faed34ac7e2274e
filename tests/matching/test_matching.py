"""Matchers recover known offsets in a simulated room; the prior holds what the scan leaves open."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.lidar import ScanPoints, surface_normals
from jaxslam.matching import CorrelativeSearch, GaussNewton, HeadingSearch, PosePrior
from tests.builders import field_of, points_of, room_cells, room_ranges

RESOLUTION, CORNER = 0.1, np.array([-4.05, -3.05])
ANGLES = np.deg2rad(np.arange(0, 360, 9))
TRUE_POSE = np.array([0.4, -0.3, 0.2])
# Half sides (x, y) of a room, and a box in it: lower and upper corner.
ROOM, BOX = np.array([3.0, 2.0]), np.array([[1.2, 0.4], [1.9, 1.1]])

ranges = functools.partial(room_ranges, angles=ANGLES, half_sides=ROOM, box=BOX)
match = jax.jit(GaussNewton.match)
search = jax.jit(CorrelativeSearch.search)


def ends_of(reach, valid=None) -> ScanPoints:
    return points_of(reach, ANGLES, valid)


@functools.cache
def room_field(walls="all"):
    """The walls drawn into 0.1 m cells, whose centers lie on them."""
    occupied = room_cells((61, 81), CORNER, RESOLUTION, *([(-ROOM, ROOM), BOX] if walls == "all" else []))
    if walls == "corridor":
        occupied[[10, 50]] = True
    return field_of(occupied, CORNER, RESOLUTION)


def prior_of(mean, precision=(0.0, 0.0, 0.0)) -> PosePrior:
    return PosePrior(jnp.asarray(mean, jnp.float32), jnp.diag(jnp.asarray(precision, jnp.float32)))


def assert_near(found, expected, meters=0.02, radians=0.01):
    error = np.asarray(found, float) - expected
    assert np.hypot(*error[:2]) < meters
    assert abs((error[2] + np.pi) % (2 * np.pi) - np.pi) < radians


# The basin on the fine field: two cells and some 6°.
@pytest.mark.parametrize(
    "offset", [(0.2, 0, 0), (-0.2, 0, 0), (0, 0.2, 0), (0, -0.2, 0), (0, 0, 0.1), (0.12, -0.12, -0.08)]
)
def test_gauss_newton_recovers_small_offsets(offset):
    start = TRUE_POSE + offset
    matcher = GaussNewton(sigma_cells=2.0, num_iterations=15)
    found = match(
        matcher,
        room_field().fine,
        ends_of(ranges(TRUE_POSE)),
        jnp.asarray(start, jnp.float32),
        prior_of(start),
    )
    assert_near(found, TRUE_POSE)


# The basin on the coarse field, whose cells are four times as large; it is left to the fine one to be exact.
@pytest.mark.parametrize("offset", [(0.5, 0, 0), (0, -0.5, 0), (0, 0, 0.25), (0.3, 0.3, -0.15)])
def test_coarse_to_fine_recovers_larger_offsets(offset):
    start, ends = TRUE_POSE + offset, ends_of(ranges(TRUE_POSE))
    prior = prior_of(start)
    near = match(
        GaussNewton(sigma_cells=1.5, num_iterations=15), room_field().coarse, ends,
        jnp.asarray(start, jnp.float32), prior,
    )  # fmt: skip
    found = match(GaussNewton(sigma_cells=2.0, num_iterations=15), room_field().fine, ends, near, prior)
    assert_near(found, TRUE_POSE)


@pytest.mark.parametrize("offset", [(1.0, 0, 0.5), (-0.7, 0.7, -0.5), (0, -1.0, 0.5236)])
def test_search_recovers_a_meter_and_thirty_degrees(offset):
    start, ends = jnp.asarray(TRUE_POSE + offset, jnp.float32), ends_of(ranges(TRUE_POSE))
    searcher = CorrelativeSearch(
        reach=1.2, reach_rotation=0.6, num_translations=13, num_rotations=25, num_beams=40
    )
    found = search(searcher, room_field(), ends, start, prior_of(start))
    # The coarse level may prefer a lattice point beside the best one, 0.2 m and 50 mrad away; the matcher,
    # which always follows, has that in its basin.
    assert_near(found, TRUE_POSE, meters=0.2, radians=0.05)
    refined = match(
        GaussNewton(sigma_cells=2.0, num_iterations=15), room_field().fine, ends, found, prior_of(found)
    )
    assert_near(refined, TRUE_POSE)


def test_search_stays_where_the_prior_is_sure():
    start, ends = jnp.asarray(TRUE_POSE + np.array([1.0, 0.0, 0.5]), jnp.float32), ends_of(ranges(TRUE_POSE))
    found = search(CorrelativeSearch(), room_field(), ends, start, prior_of(start, (1e6, 1e6, 1e6)))
    np.testing.assert_allclose(found, start, atol=1e-6)


def test_prior_keeps_the_axis_of_a_corridor():
    """Beams that only see the long walls: the scan settles y and heading, and the prior alone x."""
    reach = room_ranges(TRUE_POSE, ANGLES, np.array([1e3, 2.0]))
    ends = ends_of(np.where(reach < 4.0, reach, 0.0), reach < 4.0)
    start = TRUE_POSE + np.array([0.15, 0.12, 0.05])
    matcher = GaussNewton(sigma_cells=2.0, num_iterations=15)
    found = match(
        matcher, room_field("corridor").fine, ends, jnp.asarray(start, jnp.float32),
        prior_of(start, (10.0, 0.0, 0.0)),
    )  # fmt: skip
    assert_near(found, [start[0], *TRUE_POSE[1:]], meters=0.02)


def test_an_empty_map_returns_the_prior():
    start = jnp.asarray([0.1, 0.2, 0.3], jnp.float32)
    mean = jnp.asarray([0.2, 0.1, 0.25], jnp.float32)
    ends = ends_of(ranges(TRUE_POSE))
    found = match(GaussNewton(), room_field("none").fine, ends, start, prior_of(mean, (100.0, 100.0, 100.0)))
    # The damping of 1e-3 against a precision of 100.
    np.testing.assert_allclose(found, mean, atol=1e-4)
    # Without a prior either, it stays.
    still = match(GaussNewton(), room_field("none").fine, ends, start, prior_of(start))
    np.testing.assert_allclose(still, start, atol=1e-6)
    stayed = search(CorrelativeSearch(), room_field("none"), ends, start, prior_of(start, (1.0, 1.0, 1.0)))
    np.testing.assert_allclose(stayed, start, atol=1e-6)


def test_headings_are_taken_the_short_way_round():
    start, mean = jnp.asarray([0.0, 0.0, 3.1], jnp.float32), [0.0, 0.0, -3.1]
    ends = ends_of(ranges(TRUE_POSE))
    found = match(GaussNewton(), room_field("none").fine, ends, start, prior_of(mean, (9.0, 9.0, 9.0)))
    np.testing.assert_allclose(found, mean, atol=1e-3)
    assert -np.pi <= float(found[2]) < np.pi


def test_beams_without_return_pull_nothing():
    blind = ends_of(ranges(TRUE_POSE), np.zeros(len(ANGLES), bool))
    start = jnp.asarray([0.9, 0.9, 0.1], jnp.float32)
    found = match(GaussNewton(), room_field().fine, blind, start, prior_of(start))
    np.testing.assert_allclose(found, start, atol=1e-6)


@pytest.mark.parametrize("error", [-0.5, -0.2, 0.0, 0.3, 0.55])
def test_a_look_round_finds_the_heading(error):
    searcher = jax.jit(HeadingSearch.search)
    found = searcher(
        HeadingSearch(), room_field().coarse, ends_of(ranges(TRUE_POSE)), jnp.asarray(TRUE_POSE[:2]),
        jnp.float32(TRUE_POSE[2] + error), jnp.float32(0.2),
    )  # fmt: skip
    np.testing.assert_allclose(found[:2], TRUE_POSE[:2], atol=1e-6)
    # Headings are 0.06 rad apart, and cells of 0.4 m blur neighbors together.
    assert abs(float(found[2]) - TRUE_POSE[2]) < 0.1


def test_a_look_round_without_a_map_keeps_the_prediction():
    found = jax.jit(HeadingSearch.search)(
        HeadingSearch(), room_field("none").coarse, ends_of(ranges(TRUE_POSE)), jnp.zeros(2),
        jnp.float32(3.0), jnp.float32(0.2),
    )  # fmt: skip
    np.testing.assert_allclose(found, [0.0, 0.0, 3.0], atol=1e-6)


def test_the_end_of_a_known_wall_draws_nothing_back():
    """Beams that hit a wall past the part that the map knows: along it there is nothing to correct."""
    occupied = np.zeros((61, 81), bool)
    occupied[40, :45] = True
    field = field_of(occupied, CORNER, RESOLUTION)
    # The wall lies at y = 1 m and is known up to x = 0.4 m; the scan sees it from −1 to 1.4 m.
    points = jnp.asarray(np.stack([np.arange(-1.0, 1.4, 0.1), np.full(24, 1.0)], axis=-1), jnp.float32)
    valid = jnp.ones(24, bool)
    start = jnp.asarray([0.0, 0.08, 0.0], jnp.float32)
    matcher, prior = GaussNewton(num_iterations=10), prior_of(start, (1.0, 0.0, 0.0))
    across = match(
        matcher, field.fine, ScanPoints(points, valid, surface_normals(points, valid)), start, prior
    )
    assert abs(float(across[0])) < 1e-3
    np.testing.assert_allclose(across[1:], [0.0, 0.0], atol=0.02)
    # Without the normals the last points go to the wall's end.
    straight = match(matcher, field.fine, ScanPoints(points, valid, jnp.zeros((24, 2))), start, prior)
    assert float(straight[0]) < -0.02
