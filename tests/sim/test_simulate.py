"""The whole simulation: determinism, vmap, traces, the log, bad input."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.core import se2
from jaxslam.sim import (
    Imu,
    Lidar,
    Robot,
    Simulation,
    WheelOdometry,
    cast_rays,
    hall_small,
    random_hall,
    simulate,
    to_log,
)
from jaxslam.sim.simulate import _simulate, sample_times

LIDAR = Lidar(
    num_beams=24,
    angle_min=-np.pi / 2,
    angle_increment=np.pi / 24,
    range_min=0.05,
    range_max=6.0,
    sigma_constant=0.01,
    dropout_probability=0.05,
    pose_base_lidar=(0.1, 0.02, 0.1),
    rate=5.5,
)
DURATION = 6.0


def short_run(seed: int, **changes) -> Simulation:
    world, tour = hall_small()
    return simulate(jax.random.key(seed), world, tour, lidar=LIDAR, duration=DURATION, **changes)


@pytest.fixture(scope="module")
def run() -> Simulation:
    return short_run(0)


def test_same_key_same_bytes_other_key_other_noise(run: Simulation) -> None:
    again, other = short_run(0), short_run(1)
    for one, two in zip(jax.tree.leaves(run), jax.tree.leaves(again), strict=True):
        np.testing.assert_array_equal(one, two)
    np.testing.assert_array_equal(run.drive.poses, other.drive.poses)
    np.testing.assert_array_equal(run.scan_poses, other.scan_poses)
    for part in (
        lambda s: s.odometry.ticks,
        lambda s: s.inertial.yaw_rates,
        lambda s: s.scans.ranges,
    ):
        assert not np.array_equal(part(run), part(other))


def test_vmap_over_keys_gives_what_a_loop_gives(run: Simulation) -> None:
    world, tour = hall_small()
    keys = jnp.stack([jax.random.key(0), jax.random.key(1)])
    many = jax.vmap(lambda key: simulate(key, world, tour, lidar=LIDAR, duration=DURATION), axis_size=2)(keys)
    for index, one in enumerate([run, short_run(1)]):
        picked = jax.tree.map(lambda leaf, i=index: leaf[i], many)
        np.testing.assert_array_equal(picked.scans.valid, one.scans.valid)
        # Other vector widths round differently: some 1e-6 of a range; a wheel angle on the edge
        # between two ticks may fall on either side, which moves the pose by 0.3 mm and 0.8 mrad.
        np.testing.assert_allclose(picked.scans.ranges, one.scans.ranges, atol=5e-5)
        np.testing.assert_allclose(picked.inertial.yaw_rates, one.inertial.yaw_rates, atol=1e-6)
        assert np.abs(np.asarray(picked.odometry.ticks - one.odometry.ticks)).max() <= 1
        np.testing.assert_allclose(picked.odometry.poses, one.odometry.poses, atol=6e-3)


def test_new_values_do_not_compile_again(run: Simulation) -> None:
    del run
    before = _simulate._cache_size()
    short_run(
        3,
        robot=Robot(max_speed=0.7),
        wheels=WheelOdometry(sigma_slip=0.01),
        imu=Imu(sigma_heading=0.2),
    )
    assert _simulate._cache_size() == before


def test_halls_by_key_share_one_compilation() -> None:
    for seed in range(2):
        world, tour = random_hall(jax.random.key(seed))
        simulate(jax.random.key(0), world, tour, lidar=LIDAR, duration=1.0)
        if seed == 0:
            before = _simulate._cache_size()
    assert _simulate._cache_size() == before


def test_counts_follow_the_rates(run: Simulation) -> None:
    assert run.drive.poses.shape == (601, 3)
    assert run.odometry.poses.shape == (301, 3)
    assert run.inertial.headings.shape == (600,)
    assert run.scans.ranges.shape == (33, 24)
    assert run.scan_poses.shape == (33, 3)
    assert len(run.scan_times) == 33
    assert len(run.odometry_times) == 301
    assert len(run.imu_times) == 600


def test_sample_times() -> None:
    np.testing.assert_array_equal(sample_times(2.0, 1.0, phase=0.0), [0, 0.5, 1])
    np.testing.assert_array_equal(sample_times(2.0, 1.0, phase=0.5), [0.25, 0.75])
    # 0.3·10 is 2.9999999999999996 and 0.7·10 is 7.000000000000001 in float64.
    assert len(sample_times(10.0, 0.3, phase=0.0)) == 4
    assert len(sample_times(10.0, 0.7, phase=0.0)) == 8


def test_scans_are_taken_from_the_reference_poses(run: Simulation) -> None:
    world, _ = hall_small()
    mounting = jnp.broadcast_to(jnp.array([0.1, 0.02, 0.1]), (33, 3))
    expected = cast_rays(world, se2.compose(run.scan_poses, mounting), LIDAR.angles())
    valid = np.asarray(run.scans.valid)
    error = np.asarray(run.scans.ranges - expected)[valid]
    # Five deviations of 1 cm: 1e-7 of 700 beams lie beyond.
    assert np.abs(error).max() < 0.05
    assert valid.mean() > 0.6
    assert not valid[np.asarray(expected) > 6.05].any()


def test_log_has_every_track(run: Simulation) -> None:
    log = to_log(run, "hall", start_stamp=1.6e9)
    assert str(log.path) == "hall"
    assert log.topics == {"odom": 301, "imu": 600, "joint_states": 301, "scan": 33}
    for track in (log.odometry, log.imu, log.joints, log.scans):
        assert track.stamps[0] >= 1.6e9
        assert (np.diff(track.stamps) > 0).all()
        assert track.stamps[-1] <= 1.6e9 + DURATION
    # The sensors run at their own times: scans meet an odometry stamp only now and then.
    assert np.isin(log.scans.stamps, log.odometry.stamps).mean() < 0.1
    np.testing.assert_allclose(log.scans.stamps - 1.6e9, (np.arange(33) + 0.5) / 5.5, atol=1e-6)


def test_log_holds_what_the_simulation_holds(run: Simulation) -> None:
    log = to_log(run)
    scans, imu, joints = log.scans, log.imu, log.joints
    valid = np.asarray(run.scans.valid)
    np.testing.assert_array_equal(np.isnan(scans.ranges), ~valid)
    np.testing.assert_array_equal(scans.ranges[valid], np.asarray(run.scans.ranges)[valid])
    np.testing.assert_allclose(scans.pose_base_lidar, [0.1, 0.02, 0.1], rtol=1e-6)
    assert (scans.range_min, scans.range_max) == pytest.approx((0.05, 6.0))
    np.testing.assert_array_equal(scans.num_beams, 24)
    heading = 2 * np.arctan2(imu.orientations[:, 2], imu.orientations[:, 3])
    np.testing.assert_allclose(heading, run.inertial.headings, atol=1e-6)
    np.testing.assert_array_equal(imu.angular_velocities[:, 2], run.inertial.yaw_rates)
    np.testing.assert_array_equal(log.odometry.poses, run.odometry.poses)
    np.testing.assert_array_equal(joints.positions, run.odometry.wheel_angles)
    # Integrating the joint velocities gives the joint angles back.
    np.testing.assert_allclose(joints.velocities.sum(axis=0) / 50, joints.positions[-1], rtol=1e-9)


def test_bad_input_is_refused_before_it_is_compiled() -> None:
    world, tour = hall_small()
    key = jax.random.key(0)
    with pytest.raises(ValueError, match="at least two way-points, not 1"):
        simulate(key, world, tour[:1])
    with pytest.raises(ValueError, match=r"way-point 17 and the one after it are 0.0 m apart"):
        simulate(key, world, np.concatenate([tour, tour[:1]]))
    with pytest.raises(ValueError, match="way-point 0 and the one after it are nan m apart"):
        simulate(key, world, np.array([[np.nan, 1.0], [2.0, 1.4], [4.0, 1.4]]))
    with pytest.raises(ValueError, match=r"duration is 0.05 s, too short for one scan at 5.5 Hz"):
        simulate(key, world, tour, lidar=LIDAR, duration=0.05)
    with pytest.raises(ValueError, match="duration is nan"):
        simulate(key, world, tour, lidar=LIDAR, duration=float("nan"))
    with pytest.raises(ValueError, match=r"way-point 0 \[1.4, 1.4\] comes within 0.00 m"):
        simulate(key, world, np.array([[1.4, 1.4], [5.0, 7.0]]))
    with pytest.raises(ValueError, match=r"a robot of radius 0.9 m needs 1.10 m"):
        simulate(key, world, tour, robot=Robot(radius=0.9))
