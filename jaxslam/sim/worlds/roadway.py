"""A coal-mine roadway: two parallel drifts with few distinctive features, joined by cross-cuts."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float64, PRNGKeyArray

from jaxslam.sim.worlds.world import Site, World, box, host_generator, polyline


@dataclass(frozen=True)
class Roadway:
    """The plan of a roadway; lengths in meters.

    Attributes:
        length: length of both drifts, which run along x.
        spacing: distance between the center lines of the drifts.
        width: width of the drifts and the cross-cuts.
        cross_cuts: x of the cross-cuts' center lines; the first and the last close the loop.
        stubs: dead ends, as x and 1 for the upper drift or −1 for the lower one.
        stub_depth: depth of the dead ends.
        roughness: largest displacement of the walls to either side.
        facet: length of a wall facet.
        support_spacing: distance between support legs along both walls.
        bend: amplitude of the drifts' bends.
        bend_length: wavelength of the bends.
    """

    length: float = 71.0
    spacing: float = 16.0
    width: float = 4.0
    cross_cuts: tuple[float, ...] = (2.0, 37.0, 69.0)
    stubs: tuple[tuple[float, int], ...] = ((18.0, -1), (54.0, 1))
    stub_depth: float = 3.0
    roughness: float = 0.15
    facet: float = 0.5
    support_spacing: float = 1.5
    bend: float = 0.6
    bend_length: float = 47.0


def roadway() -> Site:
    """Build two drifts of 71 m with three cross-cuts and two dead ends; the loop is 166 m long."""
    return build_roadway("roadway", Roadway(), np.random.default_rng(0))


def random_roadway(key: PRNGKeyArray) -> Site:
    """Build a roadway with a random plan and random walls, to validate on worlds not used for tuning."""
    rng = host_generator(key)
    length, width = rng.uniform(62, 80), rng.uniform(3.6, 4.6)
    middle = length * rng.uniform(0.4, 0.6)
    stub_below = middle * rng.uniform(0.35, 0.7)
    stub_above = middle + (length - middle) * rng.uniform(0.3, 0.6)
    plan = Roadway(
        length=length,
        spacing=rng.uniform(12, 18),
        width=width,
        cross_cuts=(width / 2, middle, length - width / 2),
        stubs=((stub_below, -1), (stub_above, 1)),
        roughness=rng.uniform(0.1, 0.2),
        support_spacing=rng.uniform(1.2, 1.8),
        bend=rng.uniform(0.0, 0.8),
        bend_length=rng.uniform(35, 60),
    )
    return build_roadway("random_roadway", plan, rng)


def build_roadway(name: str, plan: Roadway, rng: np.random.Generator) -> Site:
    """Build a plan with random roughness and supports; the tour goes once round the loop."""
    half = plan.width / 2
    shapes = []
    for outline in [_outer(plan), *_pillars(plan)]:
        corners = _subdivided(outline, plan.facet)
        rough = corners + rng.uniform(-plan.roughness, plan.roughness, corners.shape)
        shapes.append(polyline(_bent(plan, rough), closed=True))
    for x, y in _bent(plan, _supports(plan)):
        shapes.append(box((x, y), (0.16, 0.16), angle=rng.uniform(0.0, 1.5)))
    left, right = plan.cross_cuts[0], plan.cross_cuts[-1]
    corners = np.array([[left, 0.0], [right, 0.0], [right, plan.spacing], [left, plan.spacing]])
    tour = _bent(plan, _subdivided(corners, 6.0))
    # Start inside the lower drift, because a corner would be easy to recognize.
    start = int(np.argmin(np.abs(tour[:, 0] - plan.length / 3) + np.abs(tour[:, 1]) * (tour[:, 1] > half)))
    return World.from_shapes(name, shapes), np.roll(tour, -start, axis=0)


def _outer(plan: Roadway) -> Float64[np.ndarray, "_ 2"]:
    """Return the outline of the open space, counter-clockwise, with the dead ends."""
    half = plan.width / 2
    low, high = -half, plan.spacing + half
    lower, upper = [(0.0, low)], [(plan.length, high)]
    for x, side in sorted(plan.stubs):
        if side < 0:
            deep = low - plan.stub_depth
            lower += [(x - half, low), (x - half, deep), (x + half, deep), (x + half, low)]
    for x, side in sorted(plan.stubs, reverse=True):
        if side > 0:
            deep = high + plan.stub_depth
            upper += [(x + half, high), (x + half, deep), (x - half, deep), (x - half, high)]
    return np.array([*lower, (plan.length, low), *upper, (0.0, high)])


def _pillars(plan: Roadway) -> list[Float64[np.ndarray, "4 2"]]:
    """Return the outlines of the coal pillars between the cross-cuts."""
    half = plan.width / 2
    low, high = half, plan.spacing - half
    edges = [(before + half, after - half) for before, after in pairwise(plan.cross_cuts)]
    return [np.array([(left, low), (right, low), (right, high), (left, high)]) for left, right in edges]


def _supports(plan: Roadway) -> Float64[np.ndarray, "_ 2"]:
    """Return the positions of the support legs: along both walls of both drifts, except at openings."""
    off_wall = plan.width / 2 - plan.roughness - 0.2
    legs = []
    for x in np.arange(plan.support_spacing / 2, plan.length, plan.support_spacing):
        for drift in (0.0, plan.spacing):
            for side in (-1, 1):
                inner = (drift == 0.0) == (side > 0)
                stubs = [place for place, where in plan.stubs if where == side]
                openings = plan.cross_cuts if inner else stubs
                if all(abs(x - opening) > plan.width / 2 + 0.3 for opening in openings):
                    legs.append((x, drift + side * off_wall))
    return np.array(legs).reshape(-1, 2)


def _subdivided(outline: Float64[np.ndarray, "P 2"], step: float) -> Float64[np.ndarray, "_ 2"]:
    """Return a closed outline with points at most `step` apart."""
    points = []
    for start, end in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        count = max(1, int(np.ceil(np.linalg.norm(end - start) / step)))
        points.append(start + (end - start) * np.arange(count)[:, None] / count)
    return np.concatenate(points)


def _bent(plan: Roadway, points: Float64[np.ndarray, "P 2"]) -> Float64[np.ndarray, "P 2"]:
    """Bend the straight drifts of the plan."""
    bend = plan.bend * np.sin(2 * np.pi * points[:, 0] / plan.bend_length)
    return points + np.stack([np.zeros(len(points)), bend], axis=1)
