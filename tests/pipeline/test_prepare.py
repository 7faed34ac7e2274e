"""From log and configuration to filter: what is fused when, and with which motion model."""

import dataclasses

import jax
import numpy as np
import pytest

from jaxslam.config.dotted import update
from jaxslam.config.lidar_presets import PRESETS
from jaxslam.config.slam import SlamConfig
from jaxslam.io import LogError
from jaxslam.motion import GaussianMotion, OdometryMotion
from jaxslam.pipeline.prepare import prepare
from jaxslam.sim import hall_small, simulate, to_log


@pytest.fixture(scope="module")
def log():
    world, waypoints = hall_small()
    return to_log(simulate(jax.random.key(0), world, waypoints, duration=120.0))


def configured(use, **changes):
    base = SlamConfig(num_particles=2).with_lidar(PRESETS["sick"])
    return update(base, {"fusion.use": use, **changes})


def without_imu(log):
    return dataclasses.replace(log, imu=None)


def without_rates(log):
    blank = np.full_like(log.imu.angular_velocities, np.nan)
    return dataclasses.replace(log, imu=dataclasses.replace(log.imu, angular_velocities=blank))


def test_off_leaves_the_wheels_alone(log):
    slam, scans = prepare(log, configured("off"))
    assert scans.fused is None
    assert type(slam.motion) is OdometryMotion
    assert not np.asarray(scans.inputs.odometry.covariance).any()


@pytest.mark.parametrize("use", ["auto", "on"])
def test_fused_odometry_moves_the_particles_by_its_covariance(log, use):
    slam, scans = prepare(log, configured(use))
    assert scans.fused is not None
    assert scans.fused.readings["imu"] == len(log.imu.stamps)
    assert type(slam.motion) is GaussianMotion
    assert np.linalg.eigvalsh(scans.inputs.odometry.covariance[1:]).min() > 0


def test_a_gaussian_motion_of_ones_own_is_kept(log):
    own = configured("on", **{"motion": "gaussian", "motion.rotation_floor": 0.02})
    assert prepare(log, own)[0].motion.rotation_floor == 0.02


@pytest.mark.parametrize("cripple", [without_imu, without_rates])
def test_auto_does_without_an_imu_that_says_nothing(log, cripple):
    slam, scans = prepare(cripple(log), configured("auto"))
    assert scans.fused is None
    assert type(slam.motion) is OdometryMotion


def test_on_refuses_a_log_without_imu(log):
    with pytest.raises(LogError, match="no IMU in it"):
        prepare(without_imu(log), configured("on"))


def test_scans_of_a_drive_that_has_no_lag_are_left_alone(log):
    """The estimate has a bias of a quarter of the interval between scans: not to be taken for a lag."""
    _, scans = prepare(log, configured("off"))
    assert scans.timing is not None
    assert scans.timing.lag is None
    chosen = log.scans.ranges[scans.scan_index]
    valid = np.asarray(scans.inputs.scan.valid)
    np.testing.assert_allclose(np.asarray(scans.inputs.scan.ranges)[valid], chosen[valid])


def test_the_method_of_the_first_paper_fuses_where_it_can(log):
    assert SlamConfig().with_method("fruit-fly").fusion.use == "auto"
    assert SlamConfig().with_method("gmapping").fusion.use == "off"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fusion.use": "yes"}, "use is 'yes', must be one of off, auto, on"),
        ({"yaw_axis": "up"}, "yaw_axis is 'up'"),
        ({"ekf.frame": "odom"}, "frame is 'odom', must be one of body, world"),
        ({"ekf.acceleration": -1.0}, "acceleration is -1.0"),
        ({"fusion.imu.rate": 0.0}, "rate is 0.0, must be > 0"),
    ],
)
def test_settings_that_make_no_sense_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        update(SlamConfig(), changes)
