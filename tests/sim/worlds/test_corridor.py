"""The corridor: its measures, its tour, its doors, and others like it."""

import jax
import numpy as np
import pytest

from jaxslam.sim import Robot, corridor_loop, make_world, random_corridor
from jaxslam.sim.worlds.world import leg_clearances


def test_it_is_as_large_as_the_papers():
    world, tour = corridor_loop()
    lower, upper = world.bounds()
    np.testing.assert_allclose(upper - lower, [43.0, 16.0], atol=1e-5)
    legs = np.diff(np.vstack([tour, tour[:1]]), axis=0)
    assert np.hypot(*legs.T).sum() == pytest.approx(2 * (40.5 + 13.5))


def test_the_tour_keeps_to_the_middle():
    world, tour = corridor_loop()
    # Half the width, less what a pilaster stands out.
    clearance = leg_clearances(np.asarray(world.segments, np.float64), tour).min()
    assert clearance == pytest.approx(2.2 / 2, abs=1e-3)
    assert clearance > float(Robot().radius)


@pytest.mark.parametrize("seed", range(8))
def test_other_corridors_can_be_driven(seed):
    world, tour = random_corridor(jax.random.key(seed))
    assert leg_clearances(np.asarray(world.segments, np.float64), tour).min() > 0.7
    again, _ = random_corridor(jax.random.key(seed))
    np.testing.assert_array_equal(world.segments, again.segments)
    other, _ = random_corridor(jax.random.key(seed + 1))
    assert world.bounds()[1].tolist() != other.bounds()[1].tolist()


def test_it_has_a_name():
    world, tour = make_world("corridor_loop")
    np.testing.assert_array_equal(world.segments, corridor_loop()[0].segments)
    assert tour.shape == (5, 2)
