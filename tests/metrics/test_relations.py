import gzip

import numpy as np
import pytest

from jaxslam.core import se2
from jaxslam.core.trajectory import interpolate_poses
from jaxslam.metrics import relation_errors, relation_residuals

# A drive along x at 1 m/s with a left turn on the spot at 3 s; the odometry reads 10 % too far.
ODOMETRY_STAMPS = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
ODOMETRY = np.array([[0.0, 0, 0], [1.1, 0, 0], [2.2, 0, 0], [3.3, 0, np.pi / 2], [3.3, 1.1, np.pi / 2]])
STAMPS = np.array([0.0, 2.0, 4.0])
POSES = np.array([[0.0, 0, 0], [2.0, 0, 0.1], [3.0, 1.0, np.pi / 2]])


def evaluate(stamps_from, stamps_to, deltas, stamps=STAMPS, poses=POSES):
    return relation_errors(
        stamps,
        poses,
        ODOMETRY_STAMPS,
        ODOMETRY,
        np.array(stamps_from, float),
        np.array(stamps_to, float),
        np.array(deltas, float).reshape(-1, 3),
    )


def test_hand_computed_relations():
    error = evaluate(
        [0.0, 0.0, 0.5, -1.0, 3.0],
        [2.0, 4.0, 1.5, 1.0, 4.1],
        [
            [2.0, 0.0, 0.0],  # at poses: only the heading is off, by 0.1 rad
            [3.0, 1.4, np.pi / 2],  # 0.4 m
            [1.0, 0.0, 0.0],  # between poses: odometry alone, 1.65 − 0.55 = 1.1 m, so 0.1 m
            [1.0, 0.0, 0.0],  # starts before the trajectory
            [1.0, 0.0, 0.0],  # ends after it
        ],
    )
    assert (error.n, error.n_unused) == (3, 2)
    assert error.trans_mean_m == pytest.approx((0.0 + 0.4 + 0.1) / 3)
    assert error.trans_std_m == pytest.approx(np.std([0.0, 0.4, 0.1]))
    assert error.trans_max_m == pytest.approx(0.4)
    assert error.rot_mean_deg == pytest.approx(np.rad2deg(0.1) / 3)
    assert error.rot_std_deg == pytest.approx(np.rad2deg(np.std([0.1, 0, 0])))
    assert error.rot_max_deg == pytest.approx(np.rad2deg(0.1))
    assert error.trans_squared_mean_m2 == pytest.approx((0.16 + 0.01) / 3)
    assert error.rot_squared_mean_deg2 == pytest.approx(np.rad2deg(0.1) ** 2 / 3)


def test_a_pose_between_scans_is_the_last_one_moved_on_by_the_odometry():
    # At 3 s: pose (2, 0, 0.1) ∘ odometry (1.1, 0, π/2). Seen from (2, 0, 0.1) that is the odometry.
    error = evaluate([2.0], [3.0], [[1.1, 0.0, np.pi / 2]])
    assert error.trans_max_m == pytest.approx(0, abs=1e-12)
    assert error.rot_max_deg == pytest.approx(0, abs=1e-9)


def test_rotation_errors_are_wrapped_and_absolute():
    error = evaluate([0.0, 0.0], [2.0, 2.0], [[2, 0, 2 * np.pi], [2, 0, 0.4]])
    # +0.1 and −0.3 rad: their mean would be −0.1, the mean of absolute values is 0.2.
    assert error.rot_mean_deg == pytest.approx(np.rad2deg(0.2))


@pytest.mark.parametrize("shift", [1e-6, -1e-6, 4e-7])
def test_stamps_equal_but_for_rounding_are_used(shift):
    # Unix-sized stamps: float64 resolves 2.4e-7 s there.
    base = 1.1e9
    error = relation_errors(
        base + STAMPS,
        POSES,
        base + ODOMETRY_STAMPS,
        ODOMETRY,
        np.array([base + (0 - abs(shift)) / 2]),
        np.array([base + 4.0 + shift / 2]),
        np.array([[3.0, 1.0, np.pi / 2]]),
    )
    assert error.n == 1
    assert error.trans_max_m == pytest.approx(0.0, abs=1e-12)


def test_a_stamp_just_before_a_pose_takes_that_pose():
    exact = evaluate([0.0], [2.0], [[2.0, 0.0, 0.1]])
    rounded = evaluate([0.0], [2.0 - 5e-7], [[2.0, 0.0, 0.1]])
    assert exact.trans_max_m == pytest.approx(0.0, abs=1e-12)
    # One pose earlier plus odometry would give 2.2 m.
    assert rounded.trans_max_m == pytest.approx(0.0, abs=1e-12)


def test_invariant_to_a_rigid_motion_of_the_trajectory():
    rng = np.random.default_rng(0)
    stamps = np.arange(0.0, 50.0, 0.7)
    poses = np.cumsum(rng.normal(0, 0.3, (len(stamps), 3)), axis=0)
    odometry = interpolate_poses(stamps, poses, np.arange(0.0, 50.0, 0.2))
    queries = np.sort(rng.uniform(0, 49, (300, 2)), axis=1)
    deltas = rng.normal(0, 1, (300, 3))
    arguments = (np.arange(0.0, 50.0, 0.2), odometry, queries[:, 0], queries[:, 1], deltas)
    moved = se2.compose(np.array([[200.0, -300.0, 2.0]]), poses)
    before = relation_residuals(stamps, poses, *arguments)
    after = relation_residuals(stamps, moved, *arguments)
    for first, second in zip(before, after, strict=True):
        np.testing.assert_allclose(first, second, atol=1e-9)


def test_truth_gives_zero_and_residuals_keep_the_order():
    rng = np.random.default_rng(1)
    stamps = np.arange(0.0, 20.0, 0.5)
    poses = np.cumsum(rng.normal(0, 0.3, (len(stamps), 3)), axis=0)
    pairs = rng.integers(0, len(stamps), (50, 2))
    deltas = se2.relative(poses[pairs[:, 0]], poses[pairs[:, 1]])
    deltas[7, 0] += 0.25
    times = stamps[pairs].T.copy()
    times[1, 9] = 99.0
    translation, rotation = relation_residuals(stamps, poses, stamps, poses, *times, deltas)
    assert np.flatnonzero(np.isnan(translation)).tolist() == [9]
    assert np.flatnonzero(np.isnan(rotation)).tolist() == [9]
    assert translation[7] == pytest.approx(0.25)
    np.testing.assert_allclose(np.delete(translation, [7, 9]), 0.0, atol=1e-9)
    np.testing.assert_allclose(np.delete(rotation, 9), 0.0, atol=1e-9)


def test_a_gap_that_the_odometry_does_not_cover_is_not_made_up():
    error = relation_errors(
        STAMPS,
        POSES,
        ODOMETRY_STAMPS[:2],
        ODOMETRY[:2],
        np.array([0.0, 0.0]),
        np.array([1.5, 4.0]),  # odometry ends at 1 s; at 4 s there is a pose, which needs none
        np.array([[1.5, 0, 0], [3.0, 1.0, np.pi / 2]]),
    )
    assert (error.n, error.n_unused) == (1, 1)
    assert error.trans_max_m == pytest.approx(0.0, abs=1e-12)


ONE = (np.zeros(1), np.ones(1), np.zeros((1, 3)))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((STAMPS, POSES, STAMPS, POSES, ONE[0] + 90, ONE[1] + 90, ONE[2]), "none of the 1 rel"),
        ((STAMPS, POSES, STAMPS, POSES, ONE[0][:0], ONE[1][:0], ONE[2][:0]), "none of the 0 rel"),
        ((STAMPS[:2], POSES, STAMPS, POSES, *ONE), "the trajectory has 3 poses but should have 2"),
        ((STAMPS, POSES, STAMPS[:0], POSES[:0], *ONE), "the odometry has no poses"),
        ((STAMPS, POSES * np.nan, STAMPS, POSES, *ONE), "trajectory pose 0 is"),
        ((STAMPS[::-1], POSES, STAMPS, POSES, *ONE), "trajectory stamps run backwards at 0"),
        ((STAMPS, POSES, STAMPS, POSES, ONE[0], STAMPS, ONE[2]), "1 from-stamps, 3 to-stamps"),
        ((STAMPS, POSES, STAMPS, POSES, ONE[0], ONE[1], ONE[2] * np.nan), "relation 0 is not"),
    ],
)
def test_bad_input_is_one_clear_line(arguments, message):
    with pytest.raises(ValueError, match=message) as caught:
        relation_errors(*arguments)
    assert "\n" not in str(caught.value)


def test_intel_odometry_alone_uses_every_relation(data_dir):
    with gzip.open(data_dir / "carmen" / "intel.clf.gz", "rt") as lines:
        scans = [line.split() for line in lines if line.startswith("FLASER")]
    # FLASER n r1…rn laser(3) odom(3) t host t.
    odometry = np.array([[float(value) for value in scan[-6:-3]] for scan in scans])
    stamps = np.array([float(scan[-3]) for scan in scans])
    rows = np.loadtxt(data_dir / "carmen" / "intel.relations")
    error = relation_errors(stamps, odometry, stamps, odometry, rows[:, 0], rows[:, 1], rows[:, [2, 3, 7]])
    assert (error.n, error.n_unused) == (2984, 0)
    # Raw odometry is far off, but not lost: meters, not kilometers, and worse than scan matching.
    assert 0.22 < error.trans_mean_m < 20
