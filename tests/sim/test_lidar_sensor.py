"""The lidar: geometry, noise, drop-outs, short readings, limits, presets."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam import sim
from jaxslam.sim import Lidar, World, box, sick

CLEAN = Lidar(
    num_beams=4,
    angle_min=0.0,
    angle_increment=math.pi / 2,
    range_min=0.1,
    range_max=10.0,
    sigma_constant=0.0,
)


@pytest.fixture(scope="module")
def room() -> World:
    return World.from_shapes("room", [box((0.0, 0.0), (4.0, 2.0))])


def measure(lidar: Lidar, distance: float, count: int = 40_000):
    distances = jnp.full((count // 4, 4), distance, jnp.float32)
    ranges, valid = lidar.measure(jax.random.key(0), distances)
    return np.asarray(ranges), np.asarray(valid)


def test_scan_of_a_room(room: World) -> None:
    scan = CLEAN.simulate(jax.random.key(0), room, jnp.zeros((2, 3)))
    np.testing.assert_allclose(scan.ranges, [[2, 1, 2, 1]] * 2, rtol=1e-6)
    assert scan.valid.all()
    np.testing.assert_allclose(scan.angle_increment, math.pi / 2)


def test_mounting_moves_and_turns_the_beams(room: World) -> None:
    lidar = dataclasses.replace(CLEAN, pose_base_lidar=(0.5, 0.0, math.pi / 2))
    scan = lidar.simulate(jax.random.key(0), room, jnp.array([[0.0, 0.0, math.pi]]))
    # The base looks left, the lidar sits at (−0.5, 0) and looks down.
    np.testing.assert_allclose(scan.ranges[0], [1, 2.5, 1, 1.5], rtol=1e-6)
    np.testing.assert_allclose(scan.pose_base_lidar, [[0.5, 0.0, math.pi / 2]], rtol=1e-6)


def test_noise_has_a_constant_and_a_proportional_part() -> None:
    lidar = dataclasses.replace(CLEAN, sigma_constant=0.03, sigma_proportional=0.01)
    ranges, valid = measure(lidar, 4.0)
    assert valid.all()
    # √(0.03² + 0.04²) = 0.05; 40 000 readings, four standard errors: 4/√80 000 = 1.4 % of it, and
    # 4·0.05/200 of the mean.
    assert ranges.std() == pytest.approx(0.05, rel=0.014)
    assert ranges.mean() == pytest.approx(4.0, abs=0.001)


def test_dropouts_come_as_often_as_they_should() -> None:
    ranges, valid = measure(dataclasses.replace(CLEAN, dropout_probability=0.2), 4.0)
    # Four standard deviations of a share: 4·√(0.2·0.8/40 000) = 0.008.
    assert (~valid).mean() == pytest.approx(0.2, abs=0.008)
    np.testing.assert_array_equal(ranges[~valid], 0)


def test_short_readings_are_uniform_before_the_wall() -> None:
    lidar = dataclasses.replace(CLEAN, short_probability=0.3, range_min=0.0)
    ranges, valid = measure(lidar, 8.0)
    assert valid.all()
    short = ranges[ranges < 7.999]
    assert len(short) / ranges.size == pytest.approx(0.3, abs=4 * (0.21 / 40_000) ** 0.5)
    # A uniform number on [0, 8): mean 4, deviation 8/√12; about 12 000 of them.
    assert short.mean() == pytest.approx(4.0, abs=4 * 8 / 12**0.5 / 12_000**0.5)


def test_limits() -> None:
    for distance, expected in [(0.09, False), (0.11, True), (9.99, True), (10.0, False)]:
        assert (measure(CLEAN, distance, 4)[1] == expected).all()
    ranges, valid = measure(CLEAN, math.inf, 4)
    assert not valid.any()
    np.testing.assert_array_equal(ranges, 0)


def test_a_person_is_seen_where_there_is_no_wall() -> None:
    lidar = dataclasses.replace(CLEAN, short_probability=1.0, range_min=0.0)
    ranges, valid = measure(lidar, math.inf, 4000)
    assert valid.mean() > 0.99
    assert ranges.max() < 10.0


@pytest.mark.parametrize(
    ("name", "num_beams", "field_of_view_deg", "range_min", "range_max", "rate"),
    [
        ("sick", 181, 180, 0.05, 80.0, 10.0),
        ("urg_04lx", 682, 239.4, 0.02, 5.6, 10.0),
        ("rplidar_a1", 360, 359, 0.15, 6.0, 5.5),
        ("lds_01", 360, 359, 0.12, 3.5, 5.0),
        ("lds_02", 260, 358.6, 0.16, 8.0, 9.0),
        ("vlp16_ring", 900, 359.6, 0.5, 100.0, 10.0),
    ],
)
def test_presets(name, num_beams, field_of_view_deg, range_min, range_max, rate) -> None:
    lidar = getattr(sim, name)()
    assert (lidar.num_beams, lidar.rate) == (num_beams, rate)
    assert (lidar.range_min, lidar.range_max) == (range_min, range_max)
    angles = np.degrees(np.asarray(lidar.angles()))
    assert angles[-1] - angles[0] == pytest.approx(field_of_view_deg, abs=0.1)
    if field_of_view_deg < 300:
        assert angles[0] == pytest.approx(-angles[-1], abs=1e-3)


def test_sick_with_180_beams_has_the_step_of_carmen_logs() -> None:
    lidar = sick(num_beams=180)
    assert lidar.angle_increment == pytest.approx(math.pi / 180)
    assert lidar.angles()[0] == pytest.approx(-math.pi / 2)


def test_sizes_that_make_no_lidar_are_refused() -> None:
    with pytest.raises(ValueError, match="num_beams is 0"):
        dataclasses.replace(CLEAN, num_beams=0)
    with pytest.raises(ValueError, match="rate is 0"):
        dataclasses.replace(CLEAN, rate=0.0)
