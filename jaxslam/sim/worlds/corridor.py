"""A corridor around a block of rooms: a long loop with few distinctive features for a short-range lidar."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import PRNGKeyArray

from jaxslam.sim.worlds.world import Site, World, host_generator, walls

_CLEAR = 1.5
"""Smallest distance of doors and pilasters from the corners, meters."""


@dataclass(frozen=True)
class Corridor:
    """The plan of a corridor; lengths in meters.

    Attributes:
        length: length of the floor along x.
        depth: length of the floor along y.
        width: width of the corridor.
        recess: depth of the doors in the outer wall and of the pilasters on the inner wall.
        spacing: smallest and largest distance between doors and between pilasters.
        door: smallest and largest width of a door.
        pilaster: smallest and largest width of a pilaster.
    """

    length: float = 43.0
    depth: float = 16.0
    width: float = 2.2
    recess: float = 0.15
    spacing: tuple[float, float] = (2.5, 6.0)
    door: tuple[float, float] = (0.85, 1.1)
    pilaster: tuple[float, float] = (0.3, 0.6)


def corridor_loop() -> Site:
    """Build a corridor like the one of Jamaludin et al.: 43 × 16 m, a loop of 108 m."""
    return build_corridor("corridor_loop", Corridor(), np.random.default_rng(0))


def random_corridor(key: PRNGKeyArray) -> Site:
    """Build a corridor of random size with random doors, to validate on worlds not used for tuning."""
    rng = host_generator(key)
    plan = Corridor(
        length=rng.uniform(32, 48),
        depth=rng.uniform(13, 20),
        width=rng.uniform(1.9, 2.6),
        recess=rng.uniform(0.1, 0.25),
    )
    return build_corridor("random_corridor", plan, rng)


def build_corridor(name: str, plan: Corridor, rng: np.random.Generator) -> Site:
    """Build a plan with random doors and pilasters; the tour starts in the middle of the lower side."""
    floor = (plan.length, plan.depth)
    around = plan.width + plan.recess
    block = (plan.length - 2 * around, plan.depth - 2 * around)
    outer = walls(floor, plan.recess, _openings(floor, plan.spacing, plan.door, rng))
    # A niche of a wall seen from inside is a protrusion when seen from outside.
    inner = walls(block, plan.recess, _openings(block, plan.spacing, plan.pilaster, rng)) + around
    middle = plan.recess + plan.width / 2
    left, right, low, high = middle, plan.length - middle, middle, plan.depth - middle
    tour = np.array([[plan.length / 2, low], [right, low], [right, high], [left, high], [left, low]])
    return World.from_shapes(name, [outer, inner]), tour


def _openings(
    size: tuple[float, float],
    spacing: tuple[float, float],
    width: tuple[float, float],
    rng: np.random.Generator,
) -> list[list[tuple[float, float]]]:
    """Return the openings of the four walls round a rectangle, as `walls` takes them."""
    sides = []
    for length in size * 2:
        openings = []
        start = _CLEAR + rng.uniform(0.0, spacing[0])
        while start + width[1] < length - _CLEAR:
            opening = rng.uniform(*width)
            openings.append((start, opening))
            start += opening + rng.uniform(*spacing)
        sides.append(openings)
    return sides
