"""Worlds as grid cells: goldens by hand, dense sampling as the oracle, flood fill."""

import numpy as np
import pytest

from jaxslam.grid.spec import GridSpec
from jaxslam.sim import World, box, hall_small, observable, polyline
from jaxslam.sim.rasterize import rasterize, reachable


def grid(height: int, width: int, resolution: float = 1.0, origin=(0.0, 0.0)) -> GridSpec:
    lower = np.array(origin)
    upper = lower + np.array([width, height]) * resolution
    return GridSpec.covering(lower, upper - 1e-3 * resolution, resolution)


def cells(picture: str) -> np.ndarray:
    """A picture with the highest row first, `#` occupied."""
    return np.array([[mark == "#" for mark in line] for line in picture.split()[::-1]])


def line(*points: tuple[float, float]) -> World:
    return World.from_shapes("line", [polyline(np.array(points))])


@pytest.mark.parametrize(
    ("points", "picture"),
    [
        ([(0.5, 0.5), (4.5, 0.5)], "..... ..... ..... ..... #####"),
        ([(2.5, 4.5), (2.5, 1.5)], "..#.. ..#.. ..#.. ..#.. ....."),
        # The diagonal runs through corners and does not mark the cells beside them.
        ([(0.5, 0.5), (4.5, 4.5)], "....# ...#. ..#.. .#... #...."),
        # Slope 1/2: it leaves the lowest row at x = 1.5 and the next one at x = 3.5.
        ([(0.5, 0.5), (4.5, 2.5)], "..... ..... ...## .###. ##..."),
        # On the line between two rows it belongs to the upper one.
        ([(1.2, 2.0), (3.8, 2.0)], "..... ..... .###. ..... ....."),
        # Half of it is off the grid.
        ([(3.5, 3.5), (9.5, 3.5)], "..... ...## ..... ..... ....."),
    ],
)
def test_golden(points: list[tuple[float, float]], picture: str) -> None:
    np.testing.assert_array_equal(rasterize(line(*points), grid(5, 5)), cells(picture))


def test_origin_and_resolution() -> None:
    world = line((-0.95, 0.55), (-0.75, 0.55))
    occupied = rasterize(world, grid(2, 4, 0.1, (-1.0, 0.4)))
    np.testing.assert_array_equal(occupied, cells("###. ...."))


def test_against_dense_sampling() -> None:
    world, _ = hall_small()
    spec = grid(320, 380, 0.05, (-0.52, -0.53))
    occupied = rasterize(world, spec)
    sampled = np.zeros_like(occupied)
    segments = np.asarray(world.segments, np.float64)
    for x1, y1, x2, y2 in segments:
        part = np.linspace(0, 1, max(2, int(np.hypot(x2 - x1, y2 - y1) / 2e-4)))
        column = np.floor((x1 + part * (x2 - x1) + 0.52) / 0.05).astype(int)
        row = np.floor((y1 + part * (y2 - y1) + 0.53) / 0.05).astype(int)
        sampled[row, column] = True
    # Sampling every 0.2 mm misses cells that a wall cuts at the very corner, never the reverse but
    # for the float32 origin.
    assert (occupied != sampled).sum() < 0.005 * sampled.sum()


def test_flood_fill_stops_at_walls_and_leaves_by_doors() -> None:
    occupied = cells("..... .###. .#.#. .###. .....")
    free = reachable(occupied, grid(5, 5), np.array([0.5, 0.5]))
    np.testing.assert_array_equal(free, cells("##### #...# #...# #...# #####"))
    inside = reachable(occupied, grid(5, 5), np.array([2.5, 2.5]))
    np.testing.assert_array_equal(inside, cells("..... ..... ..#.. ..... ....."))
    open_door = occupied.copy()
    open_door[1, 2] = False
    assert reachable(open_door, grid(5, 5), np.array([0.5, 0.5]))[2, 2]


def test_flood_fill_does_not_pass_diagonally() -> None:
    occupied = cells("#. .#")
    free = reachable(occupied, grid(2, 2), np.array([0.5, 0.5]))
    np.testing.assert_array_equal(free, cells(".. #."))


def test_observable_leaves_out_what_is_hidden() -> None:
    # A room of 8 × 8 m with a box of 4 × 4 m that holds another box.
    world = World.from_shapes(
        "nested",
        [box((5.0, 5.0), (8.0, 8.0)), box((5.0, 5.0), (4.0, 4.0)), box((5.0, 5.0), (1.0, 1.0))],
    )
    occupied, free = observable(world, grid(20, 20, 0.5), np.array([2.0, 2.0]))
    # In cells of 0.5 m: the walls are at 2 and 18, the box at 6 and 14, the inner box at 9 and 11.
    assert occupied[2, 2:19].all()
    assert occupied[6, 6:15].all()
    assert not occupied[7:14, 7:14].any()
    assert not free[7:14, 7:14].any()
    # Cells 3…17 on both axes are free but for the box, 6…14. Of that the upper right cell is free:
    # both walls end at its lower left corner.
    assert free.sum() == 15**2 - (9**2 - 1)
    assert not (occupied & free).any()


def test_hall_is_closed_and_its_cabin_open() -> None:
    world, tour = hall_small()
    spec = GridSpec.covering(np.array([-1.0, -1.0]), np.array([19.0, 16.0]), 0.05)
    _, free = observable(world, spec, tour[0])
    assert not free[0].any()

    def is_free(x: float, y: float) -> bool:
        return bool(free[int((y + 1) / 0.05), int((x + 1) / 0.05)])

    assert is_free(11.5, 11.5)  # in the cabin
    assert not is_free(5.0, 7.1)  # in the production line


def test_starts_that_cannot_be_are_refused() -> None:
    occupied = cells("#. ..")
    with pytest.raises(ValueError, match=r"\[5.0, 0.5\] lies outside the grid"):
        reachable(occupied, grid(2, 2), np.array([5.0, 0.5]))
    with pytest.raises(ValueError, match=r"\[0.5, 1.5\] lies on an occupied cell"):
        reachable(occupied, grid(2, 2), np.array([0.5, 1.5]))
