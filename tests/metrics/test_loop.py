"""Whether a loop is closed: paths and maps that are, and that are broken in one way each."""

import numpy as np
import pytest

from jaxslam.metrics import BinaryMap, loop_closed

RESOLUTION = 0.1
SIDE, WIDTH = 12.0, 2.0


def square_path(overlap: float = 4.0, step: float = 0.2) -> np.ndarray:
    """Once round a square corridor, and `overlap` meters of it again."""
    along = np.arange(0.0, 4 * SIDE + overlap, step) % (4 * SIDE)
    side, rest = np.divmod(along, SIDE)
    corners = np.array([[0.0, 0.0], [SIDE, 0.0], [SIDE, SIDE], [0.0, SIDE]])
    directions = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    position = corners[side.astype(int)] + rest[:, None] * directions[side.astype(int)]
    return np.column_stack([position, side * np.pi / 2])


def corridor_map(*shifts: tuple[float, float]) -> BinaryMap:
    """The walls of the corridor, once for each shift: a map whose loop is open has them twice."""
    size = int((SIDE + 10.0) / RESOLUTION)
    occupied = np.zeros((size, size), bool)
    for shift in shifts or ((0.0, 0.0),):
        for half in (SIDE / 2 + WIDTH / 2, SIDE / 2 - WIDTH / 2):
            points = np.arange(-half, half, RESOLUTION / 2)
            for x, y in ((points, -half), (points, half), (-half, points), (half, points)):
                x, y = np.broadcast_arrays(x + SIDE / 2 + shift[0], y + SIDE / 2 + shift[1])
                columns, rows = (np.floor((values + 5.0) / RESOLUTION).astype(int) for values in (x, y))
                occupied[rows, columns] = True
    return BinaryMap(occupied, np.zeros_like(occupied), RESOLUTION, np.array([-5.0, -5.0]))


TRUTH = square_path()


def test_a_perfect_run_is_closed():
    found = loop_closed(TRUTH, TRUTH, corridor_map(), corridor_map())
    assert found.closed
    assert found.revisits > 10
    assert found.position_error < 1e-9
    assert found.heading_error < 1e-9
    assert found.walls_once == 1.0


def test_a_run_in_another_frame_is_as_closed():
    turn, shift = 0.5, np.array([3.0, -2.0])
    cos, sin = np.cos(turn), np.sin(turn)
    moved = np.column_stack([TRUTH[:, :2] @ np.array([[cos, sin], [-sin, cos]]) + shift, TRUTH[:, 2] + turn])
    found = loop_closed(TRUTH, moved, corridor_map(), corridor_map())
    assert found.position_error < 1e-9
    assert found.heading_error < 1e-9


def test_drift_that_was_made_good_does_not_open_a_loop():
    estimate = TRUTH.copy()
    # Half-way round it is a meter off, at the end no more.
    estimate[:, 0] += np.sin(np.linspace(0.0, np.pi, len(TRUTH)))
    estimate[-25:] = TRUTH[-25:]
    assert loop_closed(TRUTH, estimate, corridor_map(), corridor_map()).closed


@pytest.mark.parametrize(
    ("shift", "turn", "closed"), [(0.2, 0.0, True), (0.45, 0.0, False), (0.0, 0.05, True), (0.0, 0.15, False)]
)
def test_a_path_that_does_not_meet_itself_is_open(shift, turn, closed):
    estimate = TRUTH.copy()
    estimate[-25:] += [shift, 0.0, turn]
    found = loop_closed(TRUTH, estimate, corridor_map(), corridor_map(), min_walls_once=0.0)
    assert found.closed == closed
    assert abs(found.position_error - shift) < 1e-6 + 0.2 * turn
    assert abs(found.heading_error - turn) < 1e-6


def test_walls_that_were_drawn_twice_are_seen_though_the_path_meets_itself():
    doubled = loop_closed(TRUTH, TRUTH, corridor_map(), corridor_map((0.0, 0.0), (0.5, 0.5)))
    assert not doubled.closed
    assert doubled.position_error < 1e-9
    assert doubled.walls_once < 0.7
    assert loop_closed(TRUTH, TRUTH, corridor_map(), corridor_map((0.0, 0.0), (0.1, 0.1))).closed


def test_a_map_without_walls_is_not_closed():
    nothing = corridor_map()
    nothing.occupied[:] = False
    found = loop_closed(TRUTH, TRUTH, corridor_map(), nothing)
    assert not found.closed
    assert found.walls_once == 0.0
    assert not loop_closed(TRUTH, TRUTH, nothing, corridor_map()).closed


def test_there_must_be_a_loop():
    with pytest.raises(ValueError, match="there is no loop"):
        loop_closed(TRUTH[:200], TRUTH[:200], corridor_map(), corridor_map())
    with pytest.raises(ValueError, match="at the same stamps"):
        loop_closed(TRUTH, TRUTH[:-1], corridor_map(), corridor_map())
