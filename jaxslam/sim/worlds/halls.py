"""The built-in worlds, each with the way-points of a drive through it.

`drive` starts at the first way-point. To add a world, add its builder to `WORLDS`.
"""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from jaxtyping import Float64, PRNGKeyArray

from jaxslam.core.names import check_names
from jaxslam.sim.worlds.corridor import corridor_loop
from jaxslam.sim.worlds.roadway import roadway
from jaxslam.sim.worlds.world import Site, World, box, disc, host_generator, polyline, walls

_TOUR_OF_SIX_BLOCKS = "a0 c0 c3 a3 a0 a2 c2 c1 a1 a0 b0 b3 a3 a0 b0 b1 a1"


def hall_small() -> Site:
    """Build a factory hall of 18 × 15 m with machines, tanks and a cabin; the tour is 161 m, 195 s.

    Three bands of machines between four aisles, with rows of equal machines in two of them. The
    tour goes round the hall first (54 m, 61 s), then through the inner aisles in three more loops.
    """
    niches = [[(2.6, 2.4), (12.2, 1.6)], [(6.6, 2.0)], [(4.0, 1.2), (10.6, 2.4)], [(2.2, 1.4)]]
    shapes = [
        walls((18.0, 15.0), 0.25, niches),
        # Lower band: a row of three equal machines, then a turned press, a tank and a cabinet.
        *row_of_boxes((3.2, 3.2), (1.9, 0.0), 3, (1.3, 1.5)),
        box((10.9, 3.2), (2.0, 1.2), angle=0.25),
        disc((13.0, 3.1), 0.65),
        box((14.8, 3.3), (1.0, 1.7)),
        # Middle band: a production line with feeders, then the same row of three again.
        box((5.0, 7.1), (5.2, 0.9)),
        box((3.4, 7.8), (0.9, 0.5)),
        box((6.2, 6.35), (1.4, 0.6)),
        *row_of_boxes((10.9, 7.1), (1.9, 0.0), 3, (1.3, 1.5)),
        # Upper band: tanks, a chamfered machine and a cabin with an open door.
        disc((3.2, 11.3), 0.8),
        disc((5.2, 11.5), 0.55),
        box((6.9, 11.2), (1.6, 1.3), chamfer=0.3),
        cabin((10.0, 10.2), (3.0, 2.1), door=(1.9, 0.8)),
        box((14.8, 11.4), (1.4, 1.4), angle=0.6),
        # Against the walls: cabinets, crates and pillars.
        box((0.45, 6.2), (0.4, 1.6)),
        box((0.4, 11.9), (0.3, 0.8)),
        box((7.4, 0.45), (1.8, 0.4)),
        box((17.55, 3.4), (0.4, 1.2)),
        box((17.5, 10.4), (0.5, 0.5)),
        box((3.4, 14.5), (2.2, 0.5)),
        box((17.25, 14.25), (0.7, 0.7), angle=0.4),
    ]
    tour = lattice_tour([1.4, 8.8, 16.5], [1.4, 5.1, 9.2, 13.4], _TOUR_OF_SIX_BLOCKS)
    return World.from_shapes("hall_small", shapes), tour


def hall_large() -> Site:
    """Build a factory hall of 24 × 23 m with machines, tanks, shelves and a cabin; the tour is 166 m, 191 s.

    Four bands of three blocks between five aisles, with the same row of machines three times. The
    tour goes round the hall (81 m, 89 s), then through the inner aisles in a figure of eight.
    """
    niches = [
        [(3.0, 3.0), (14.0, 1.6), (18.5, 1.6)],
        [(5.0, 2.4), (16.0, 1.4)],
        [(6.5, 3.0), (17.0, 1.2)],
        [(9.0, 2.0), (13.0, 2.0)],
    ]
    shapes = [
        walls((24.0, 23.0), 0.3, niches),
        # First band: equal machines on the left and in the middle, tanks on the right.
        *row_of_boxes((3.2, 3.9), (1.9, 0.0), 3, (1.4, 2.2)),
        *row_of_boxes((10.2, 3.9), (1.9, 0.0), 3, (1.4, 2.2)),
        disc((17.9, 3.9), 1.0),
        disc((20.3, 4.1), 0.7),
        # Second band: a line with feeders, a turned press, shelves.
        box((5.1, 8.8), (4.6, 1.0)),
        box((3.7, 9.7), (1.0, 0.8)),
        box((6.4, 7.9), (1.2, 0.8)),
        box((12.1, 8.9), (3.6, 2.0), angle=0.2),
        *row_of_boxes((19.0, 7.9), (0.0, 1.0), 3, (4.4, 0.4)),
        # Third band: equal machines again, an office cabin, a chamfered pair.
        *row_of_boxes((3.2, 14.0), (1.9, 0.0), 3, (1.4, 2.2)),
        cabin((10.1, 12.7), (4.2, 2.7), door=(0.6, 0.9)),
        box((17.7, 14.1), (1.8, 2.0), chamfer=0.4),
        box((20.4, 13.9), (1.6, 2.4), chamfer=0.3),
        # Fourth band: tanks, a turned line, crates.
        disc((3.6, 19.0), 0.9),
        disc((6.4, 19.1), 0.9),
        box((12.1, 19.0), (4.4, 1.0), angle=-0.15),
        box((17.6, 18.6), (1.2, 1.2), angle=0.3),
        box((19.4, 19.3), (1.0, 1.0), angle=-0.4),
        box((20.9, 18.5), (0.9, 1.4)),
        # Against the walls.
        box((0.55, 4.3), (0.5, 2.0)),
        box((0.5, 16.4), (0.4, 0.9)),
        box((9.6, 0.55), (2.4, 0.5)),
        box((23.5, 11.0), (0.4, 2.6)),
        box((23.4, 19.7), (0.6, 0.6)),
        box((11.6, 22.4), (3.0, 0.6)),
        box((0.95, 22.05), (0.9, 0.9), angle=0.5),
    ]
    junctions = "a0 d0 d4 a4 a0 a2 d2 d3 b3 b1 c1 c0"
    tour = lattice_tour([1.6, 8.6, 15.6, 22.3], [1.6, 6.3, 11.4, 16.6, 21.3], junctions)
    return World.from_shapes("hall_large", shapes), tour


def random_hall(key: PRNGKeyArray) -> Site:
    """Build a random hall, 16–24 × 14–22 m, to validate on worlds not used for tuning.

    All keys give the same number of segments and way-points, so that all halls share one compiled
    simulation.
    """
    rng = host_generator(key)
    width, height = rng.uniform(16, 24), rng.uniform(14, 22)
    columns = np.array([1.5, width * rng.uniform(0.42, 0.58), width - 1.5])
    rows = np.linspace(1.5, height - 1.5, 4)
    rows[1:-1] += rng.uniform(-0.3, 0.3, 2)
    niches = [[(rng.uniform(0.2, 0.7) * side, 1.6)] for side in (width, height, width, height)]
    shapes = [walls((width, height), 0.25, niches)]
    for left, right in pairwise(columns):
        for lower, upper in pairwise(rows):
            shapes += _random_machines(rng, (left, right), (lower, upper))
    for side in (0.0, width):
        for position in rng.uniform(1.0, height - 1.0, 3):
            shapes.append(box((abs(side - 0.4), position), (0.35, rng.uniform(0.3, 1.5))))
    tour = lattice_tour(columns.tolist(), rows.tolist(), _TOUR_OF_SIX_BLOCKS)
    if rng.uniform() >= 0.5:
        # Swap left and right, so that tours run in both directions.
        sign, shift = np.array([-1.0, 1.0]), np.array([width, 0.0])
        shapes = [shape * np.tile(sign, 2) + np.tile(shift, 2) for shape in shapes]
        tour = tour * sign + shift
    return World.from_shapes("random_hall", shapes), tour


WORLDS: dict[str, Callable[[], Site]] = {
    "hall_small": hall_small,
    "hall_large": hall_large,
    "roadway": roadway,
    "corridor_loop": corridor_loop,
}


def make_world(name: str) -> Site:
    """Return the built-in world of that name and its way-points `[W, 2]`.

    Raises:
        ValueError: the world is unknown; the message suggests the nearest name.
    """
    check_names("no world is called", WORLDS, name)
    return WORLDS[name]()


def cabin(
    corner: tuple[float, float], size: tuple[float, float], *, door: tuple[float, float]
) -> Float64[np.ndarray, "_ 4"]:
    """Build a room whose lower wall has an open door, (start, width) from its left corner, meters."""
    (width, height), (start, opening) = size, door
    corners = [(0.0, 0.0), (0.0, height), (width, height), (width, 0.0)]
    outline = [(start, 0.0), *corners, (start + opening, 0.0)]
    return polyline(np.array(outline) + np.asarray(corner))


def row_of_boxes(
    first: tuple[float, float], step: tuple[float, float], count: int, size: tuple[float, float]
) -> list[Float64[np.ndarray, "_ 4"]]:
    """Return `count` equal machines, the first centered on `first`, each `step` further, meters."""
    return [box((first[0] + i * step[0], first[1] + i * step[1]), size) for i in range(count)]


def lattice_tour(columns: list[float], rows: list[float], junctions: str) -> Float64[np.ndarray, "W 2"]:
    """Return way-points at aisle crossings: "b2" is the second column (x) and the third row (y)."""
    return np.array([(columns[ord(name[0]) - ord("a")], rows[int(name[1:])]) for name in junctions.split()])


def _random_machines(
    rng: np.random.Generator, x_range: tuple[float, float], y_range: tuple[float, float]
) -> list[Float64[np.ndarray, "8 4"]]:
    """Return three chamfered machines in the block between two columns and two rows of aisles."""
    # Half an aisle is left free on every side.
    left, right = x_range[0] + 0.9, x_range[1] - 0.9
    lower, upper = y_range[0] + 0.9, y_range[1] - 0.9
    slot = np.array([(right - left) / 3, upper - lower])
    machines = []
    for index in range(3):
        center = (left + (index + 0.5) * slot[0], (lower + upper) / 2)
        size = slot * rng.uniform(0.45, 0.95, 2)
        angle = rng.choice([0.0, rng.uniform(-0.6, 0.6)])
        cos, sin = np.cos(angle), np.abs(np.sin(angle))
        # Shrink the machine until it fits its slot when turned.
        turned = np.array([cos * size[0] + sin * size[1], sin * size[0] + cos * size[1]])
        size = size * min(1.0, *(slot / turned))
        # From nearly square corners to an octagon.
        chamfer = size.min() * rng.choice([0.03, 0.15, 0.29])
        machines.append(box(center, (size[0], size[1]), angle=angle, chamfer=chamfer))
    return machines
