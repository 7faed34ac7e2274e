"""Sensors merged into one stream, and what comes out of it."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from jaxslam.config.thinning import Thinning
from jaxslam.fusion import EKF, ImuNoise, OdometerNoise, fuse, merge, yaw_track
from jaxslam.io.log import ImuTrack, LogError, OdometryTrack, ScanTrack, SensorLog
from jaxslam.pipeline.fusion import with_fused_odometry
from jaxslam.pipeline.inputs import pair_scans

STAMPS = np.arange(0.0, 20.0, 0.1)
QUERIES = np.arange(0.0, 19.5, 0.5)


def truth(stamps):
    """A circle of 1 m radius at 0.5 m/s."""
    heading = 0.5 * stamps
    return np.stack([np.sin(heading), 1 - np.cos(heading), (heading + np.pi) % (2 * np.pi) - np.pi], axis=-1)


def odometry(scale=1.0, stamps=STAMPS):
    """Wheels that turn `scale` times as much as the robot does."""
    heading = scale * 0.5 * stamps
    step = np.diff(stamps, prepend=stamps[0]) * 0.5
    x, y = np.cumsum(step * np.cos(heading)), np.cumsum(step * np.sin(heading))
    return OdometryTrack(
        stamps, np.stack([x, y, heading], axis=-1), np.full((len(stamps), 3), np.nan), "odom"
    )


def imu(up=(0.0, 0.0, 1.0), rate=0.5, stamps=STAMPS + 0.03):
    up = np.array(up)
    count = len(stamps)
    return ImuTrack(
        stamps,
        np.full((count, 4), np.nan),
        rate * np.tile(up, (count, 1)),
        9.81 * np.tile(up, (count, 1)),
        np.eye(3),
        False,
        "imu",
    )


def run(odometry_track, yaw, **options):
    return fuse(EKF(), merge(odometry_track, yaw, QUERIES, OdometerNoise(), ImuNoise(), **options))


def test_the_gyro_puts_right_what_the_wheels_turn_wrong():
    wheels = odometry(scale=1.2)
    alone, both = run(wheels, None), run(wheels, yaw_track(imu(), wheels))
    errors = [np.hypot(*(fused.poses - truth(QUERIES))[:, :2].T).max() for fused in (alone, both)]
    # Wheels that turn 20 % too much, over 10 rad; the rest of it is what the filter still believes of them.
    assert errors[0] > 0.5
    assert errors[1] < 0.25
    assert both.readings == {"odometry": len(STAMPS) - 1, "imu": len(STAMPS)}


def test_deltas_chain_up_to_the_poses():
    from jaxslam.core import se2

    fused = run(odometry(), yaw_track(imu(), None))
    pose = fused.poses[0]
    for delta, expected in zip(fused.deltas[1:], fused.poses[1:], strict=True):
        pose = se2.compose(pose, delta)
        np.testing.assert_allclose(pose[:2], expected[:2], atol=2e-3)
    assert np.linalg.eigvalsh(fused.covariances[1:]).min() > 0
    assert not fused.deltas[0].any()


@pytest.mark.parametrize("axis", [(0, 0, 1), (0, 1, 0), (-1, 0, 0)], ids=["z", "y", "-x"])
def test_gravity_tells_which_axis_is_up(axis):
    yaw = yaw_track(imu(axis), None)
    assert yaw.source == "gravity"
    np.testing.assert_allclose(yaw.rates, 0.5)


def test_a_given_axis_wins_and_an_unknown_one_is_refused():
    assert yaw_track(imu((0, 1, 0)), None, axis="-y").rates[0] == -0.5
    with pytest.raises(LogError, match="--imu-yaw-axis is 'w': give one of x, y, z"):
        yaw_track(imu(), None, axis="w")


def test_an_imu_without_any_turning_is_refused():
    empty = dataclasses.replace(imu(), angular_velocities=np.full((len(STAMPS), 3), np.nan))
    with pytest.raises(LogError, match="neither turning rates nor orientations"):
        yaw_track(empty, None)


def test_a_bias_is_taken_from_where_the_robot_stands():
    still = OdometryTrack(STAMPS, np.zeros((len(STAMPS), 3)), np.full((len(STAMPS), 3), np.nan), "odom")
    yaw = yaw_track(imu(rate=0.02), still)
    assert yaw.bias == pytest.approx(0.02)
    np.testing.assert_allclose(yaw.rates, 0.0, atol=1e-12)


def test_the_imu_alone_turns_and_the_odometry_alone_moves():
    turning = run(None, yaw_track(imu(), None))
    np.testing.assert_allclose(turning.deltas[5:, 2], 0.25, atol=0.01)
    np.testing.assert_allclose(run(odometry(), None).deltas[5:, 2], 0.25, atol=0.01)
    with pytest.raises(ValueError, match="neither odometry nor an IMU"):
        merge(None, None, QUERIES, OdometerNoise(), ImuNoise())


def test_a_jump_of_the_odometry_is_refused():
    wheels = odometry()
    poses = wheels.poses.copy()
    poses[100:, 0] += 5.0
    fused = run(dataclasses.replace(wheels, poses=poses), yaw_track(imu(), None))
    assert fused.refused["odometry"] == 1
    assert np.hypot(*(fused.poses - truth(QUERIES))[:, :2].T).max() < 0.2


def without(rows) -> OdometryTrack:
    wheels = odometry()
    return OdometryTrack(wheels.stamps[rows], wheels.poses[rows], wheels.twists[rows], "odom")


def test_over_a_gap_the_uncertainty_grows():
    gap = without(np.r_[0:50, 149:200])
    fused, whole = (run(wheels, yaw_track(imu(), None)) for wheels in (gap, odometry()))
    assert np.isfinite(fused.poses).all()
    assert np.isfinite(fused.covariances).all()
    inside = (QUERIES > 8.0) & (QUERIES < 14.0)
    assert (fused.sigmas[inside, 0] > 5 * whole.sigmas[inside, 0]).all()


def test_a_repeated_stamp_is_read_once():
    twice = without(np.r_[0:50, 49:200])
    fused, once = (run(wheels, yaw_track(imu(), None)) for wheels in (twice, odometry()))
    np.testing.assert_allclose(fused.poses, once.poses, atol=1e-3)
    assert fused.readings == once.readings


def test_poses_can_be_read_as_the_paper_has_it():
    fused = run(odometry(), yaw_track(imu(), None), use_poses=True)
    assert np.hypot(*(fused.poses - truth(QUERIES))[:, :2].T).max() < 0.1


def test_inputs_get_the_fused_increments():
    wheels = odometry(scale=1.2)
    beams = np.ones((len(STAMPS), 8), np.float32)
    per_scan = np.zeros(len(STAMPS))
    scans = ScanTrack(
        STAMPS, beams, np.full(len(STAMPS), 8), per_scan, per_scan + 0.7, 0.1, 5.0, np.zeros(3), True, "scan"
    )
    log = SensorLog(Path("circle"), odometry=wheels, imu=imu(), scans=scans)
    plain = pair_scans(log, Thinning(0.5, 0.5))
    prepared = with_fused_odometry(plain, log)
    fused = prepared.fused
    delta = np.asarray(prepared.inputs.odometry.delta)
    intervals = np.diff(prepared.stamps)
    assert np.abs(delta[1:, 2] - 0.5 * intervals).max() < 0.05
    assert np.abs(np.asarray(plain.inputs.odometry.delta)[1:, 2] - 0.5 * intervals).max() > 0.08
    assert np.linalg.eigvalsh(prepared.inputs.odometry.covariance[1:]).min() > 0
    np.testing.assert_array_equal(prepared.scan_index, plain.scan_index)
    # Asked more often, the filter takes shorter steps.
    np.testing.assert_allclose(prepared.all_odometry[plain.scan_index], fused.poses, atol=2e-3)
    with pytest.raises(LogError, match="no IMU in it"):
        with_fused_odometry(plain, dataclasses.replace(log, imu=None))
