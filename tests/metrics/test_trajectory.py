import copy
import dataclasses
import itertools

import numpy as np
import pytest
from evo.core import lie_algebra, metrics, sync
from evo.core.trajectory import PoseTrajectory3D
from evo.core.units import Unit

from jaxslam.core import se2
from jaxslam.metrics import absolute_trajectory_error, align_se2, associate, pose_errors, relative_pose_error


def wander(seed: int, length: int = 200) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stamps, a reference and a drifting estimate of it in another frame."""
    rng = np.random.default_rng(seed)
    stamps = 1.1e9 + 0.1 * np.arange(length)
    heading = np.cumsum(rng.normal(0, 0.2, length))
    step = rng.uniform(0.01, 0.3, length)
    position = np.cumsum(step[:, None] * np.stack([np.cos(heading), np.sin(heading)], 1), axis=0)
    reference = np.column_stack([position, np.mod(heading + np.pi, 2 * np.pi) - np.pi])
    noise = np.cumsum(rng.normal(0, [0.02, 0.02, 0.01], (length, 3)), axis=0)
    frame = np.array([[3.0, -7.0, 2.5]])
    return stamps, reference, se2.compose(frame, se2.compose(reference, noise))


def embed(stamps: np.ndarray, poses: np.ndarray) -> PoseTrajectory3D:
    """The planar trajectory as evo's 3-D one."""
    matrices = [
        lie_algebra.se3(lie_algebra.so3_exp(np.array([0.0, 0.0, theta])), np.array([x, y, 0.0]))
        for x, y, theta in poses
    ]
    return PoseTrajectory3D(poses_se3=matrices, timestamps=stamps)


def evo_error(metric: type, relation: metrics.PoseRelation, pair, **options) -> metrics.PE:
    error = metric(relation, **options)
    error.process_data(pair)
    return error


def assert_same(ours, translation: metrics.PE, rotation: metrics.PE) -> None:
    expected = translation.get_all_statistics()
    assert ours.n == len(translation.error)
    for name in ("rmse", "mean", "std", "max"):
        assert getattr(ours, f"{name}_m") == pytest.approx(expected[name], rel=1e-9)
    # evo takes the angle of a matrix logarithm, which loses digits near zero.
    assert ours.rot_rmse_deg == pytest.approx(rotation.get_all_statistics()["rmse"], rel=1e-6)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("align", ["se2", "first_pose", False])
def test_absolute_error_is_evos(seed, align):
    stamps, reference, estimate = wander(seed)
    kept = np.random.default_rng(seed).permutation(len(stamps))[:150]
    kept.sort()
    ours = absolute_trajectory_error(stamps, reference, stamps[kept] + 0.004, estimate[kept], align=align)

    theirs_reference, theirs = sync.associate_trajectories(
        embed(stamps, reference), embed(stamps[kept] + 0.004, estimate[kept]), max_diff=0.01
    )
    if align == "se2":
        theirs.align(theirs_reference)
    elif align == "first_pose":
        theirs.align_origin(theirs_reference)
    pair = (theirs_reference, theirs)
    assert ours.n == 150
    assert_same(
        ours,
        evo_error(metrics.APE, metrics.PoseRelation.translation_part, pair),
        evo_error(metrics.APE, metrics.PoseRelation.rotation_angle_deg, pair),
    )


@pytest.mark.parametrize(
    ("delta", "unit", "evo_unit", "all_pairs"),
    [
        (7, "frames", Unit.frames, True),
        (7, "frames", Unit.frames, False),
        (1.3, "meters", Unit.meters, False),
    ],
)
def test_relative_error_is_evos(delta, unit, evo_unit, all_pairs):
    stamps, reference, estimate = wander(3)
    ours = relative_pose_error(
        stamps, reference, stamps, estimate, delta=delta, unit=unit, all_pairs=all_pairs
    )
    pair = (embed(stamps, reference), embed(stamps, estimate))
    options = {"delta": delta, "delta_unit": evo_unit, "all_pairs": all_pairs}
    options["pairs_from_reference"] = True
    assert_same(
        ours,
        evo_error(metrics.RPE, metrics.PoseRelation.translation_part, pair, **options),
        evo_error(metrics.RPE, metrics.PoseRelation.rotation_angle_deg, pair, **options),
    )


@pytest.mark.parametrize(("delta", "unit"), [(1.3, "meters"), (2.0, "seconds")])
def test_relative_error_over_all_pairs_is_the_loop(delta, unit):
    stamps, reference, estimate = wander(4, length=80)
    if unit == "meters":
        steps = np.hypot(*np.diff(reference[:, :2], axis=0).T)
        progress = [0.0, *itertools.accumulate(steps)]
    else:
        progress = list(0.1 * np.arange(80))
    errors = []
    for i in range(80):
        ends = [j for j in range(80) if progress[j] >= progress[i] + delta - 1e-6]
        if ends:
            motions = [se2.relative(path[i], path[ends[0]]) for path in (reference, estimate)]
            errors.append(se2.relative(*motions))
    distances = np.hypot(*np.array(errors)[:, :2].T)

    ours = relative_pose_error(stamps, reference, stamps, estimate, delta=delta, unit=unit)

    assert ours.n == len(errors)
    assert 0 < ours.n < 79
    assert ours.mean_m == pytest.approx(distances.mean(), rel=1e-9)
    assert ours.max_m == pytest.approx(distances.max(), rel=1e-9)


def test_seconds_and_frames_agree_on_an_even_clock():
    stamps, reference, estimate = wander(5)
    frames = relative_pose_error(stamps, reference, stamps, estimate, delta=10, unit="frames")
    # Unix stamps carry steps of 1.2e-7 s: 10 × 0.1 s must still count as 1 s.
    seconds = relative_pose_error(stamps, reference, stamps, estimate, delta=1.0, unit="seconds")
    assert frames == seconds


def test_hand_computed_absolute_error():
    stamps = np.array([0.0, 1.0, 2.0, 3.0])
    reference = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, np.pi - 0.1]])
    estimate = np.array([[0.0, 0, 0], [1, 3, 0], [2, 0, 0.3], [3, -4, -np.pi + 0.1]])
    error = absolute_trajectory_error(stamps, reference, stamps, estimate, align=False)
    # Distances 0, 3, 0, 4; headings 0, 0, 0.3, 0.2 through ±π.
    assert error.rmse_m == pytest.approx(2.5)
    assert error.mean_m == pytest.approx(1.75)
    assert error.std_m == pytest.approx(np.sqrt(25 / 4 - 1.75**2))
    assert error.max_m == pytest.approx(4.0)
    assert error.rot_rmse_deg == pytest.approx(np.rad2deg(np.sqrt(0.13 / 4)))
    assert error.n == 4


def test_alignment_recovers_the_frame_exactly_far_from_the_origin():
    _, reference, _ = wander(6)
    # UTM-sized coordinates: float64 resolves 1e-9 m there, so 1e-7 leaves room for the sums.
    reference[:, :2] += [4.5e5, 5.4e6]
    frame = np.array([-20.0, 31.0, -2.9])
    estimate = se2.relative(frame[None], reference)
    found = align_se2(reference, estimate)
    np.testing.assert_allclose(se2.compose(found[None], estimate), reference, atol=1e-6)
    # The heading is good to rounding / spread ≈ 1e-9 / 1 m.
    assert found[2] == pytest.approx(-2.9, abs=1e-8)


def test_alignment_is_least_squares():
    _, reference, estimate = wander(7)

    def cost(pose: np.ndarray) -> float:
        moved = se2.compose(pose[None], estimate)
        return float(np.sum((moved[:, :2] - reference[:, :2]) ** 2))

    best = align_se2(reference, estimate)
    for nudge in np.concatenate([np.eye(3), -np.eye(3)]) * 1e-3:
        assert cost(best + nudge) > cost(best)


def test_errors_ignore_the_frame_of_the_estimate():
    stamps, reference, estimate = wander(8)
    moved = se2.compose(np.array([[100.0, 50.0, 1.0]]), estimate)
    first = absolute_trajectory_error(stamps, reference, stamps, estimate)
    second = absolute_trajectory_error(stamps, reference, stamps, moved)
    for name, value in dataclasses.asdict(first).items():
        assert getattr(second, name) == pytest.approx(value, abs=1e-9)


def test_pose_errors_are_what_the_statistics_summarize():
    stamps, reference, estimate = wander(9)
    errors = pose_errors(stamps, reference, stamps, estimate)
    summary = absolute_trajectory_error(stamps, reference, stamps, estimate)
    np.testing.assert_array_equal(errors.stamps, stamps)
    assert summary.max_m == errors.position_m.max()
    assert summary.rot_rmse_deg == pytest.approx(np.rad2deg(np.sqrt(np.mean(errors.heading_rad**2))))


def test_inputs_are_left_alone():
    stamps, reference, estimate = wander(10)
    before = copy.deepcopy((stamps, reference, estimate))
    absolute_trajectory_error(stamps, reference, stamps, estimate)
    for now, then in zip((stamps, reference, estimate), before, strict=True):
        np.testing.assert_array_equal(now, then)


def test_association_is_one_to_one_and_nearest():
    reference = np.array([0.0, 1.0, 2.0, 9.0])
    estimate = np.array([0.9, 1.2, 2.1, 20.0])
    index_reference, index_estimate = associate(reference, estimate, 0.5)
    # 1.2 is nearest to 1.0 too, but 0.9 is nearer; 0.0 has no partner within 0.5 s.
    np.testing.assert_array_equal(index_reference, [1, 2])
    np.testing.assert_array_equal(index_estimate, [0, 2])


def test_association_with_duplicate_stamps_uses_each_pose_once():
    index_reference, index_estimate = associate(np.array([0.0, 1.0, 1.0]), np.array([1.0, 1.0]), 0)
    assert len(set(index_reference)) == len(index_reference) == 1
    assert len(set(index_estimate)) == len(index_estimate) == 1


def test_float32_input_is_accepted():
    stamps = np.arange(5, dtype=np.float32)
    poses = np.zeros((5, 3), np.float32)
    poses[:, 0] = stamps
    assert absolute_trajectory_error(stamps, poses, stamps, poses).max_m == pytest.approx(0, abs=1e-6)


STAMPS = np.arange(4.0)
LINE = np.stack([STAMPS, 0 * STAMPS, 0 * STAMPS], axis=1)


def broken(array: np.ndarray, index, value: float) -> np.ndarray:
    array = array.copy()
    array[index] = value
    return array


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((STAMPS, LINE, STAMPS + 100, LINE), {}, "no stamps match within 0.01 s"),
        ((STAMPS, LINE, STAMPS[:1], LINE[:1]), {}, "1 matched pose cannot determine a rotation"),
        ((STAMPS, LINE, STAMPS[:0], LINE[:0]), {}, "the estimate has no poses"),
        ((STAMPS, LINE, STAMPS, LINE[:3]), {}, "the estimate has 3 poses but should have 4"),
        ((STAMPS[:3], LINE, STAMPS, LINE), {}, "the reference has 4 poses but should have 3"),
        ((STAMPS, LINE, STAMPS, broken(LINE, (2, 1), np.nan)), {}, "estimate pose 2 is"),
        ((broken(STAMPS, 1, np.inf), LINE, STAMPS, LINE), {}, "reference stamp 1 is inf"),
        ((STAMPS[::-1], LINE, STAMPS, LINE), {}, "reference stamps run backwards at 0"),
        ((STAMPS, LINE, STAMPS, 0 * LINE), {}, "do not determine a rotation"),
        ((STAMPS, LINE, STAMPS, LINE), {"max_difference": -1.0}, "max_difference is -1.0"),
    ],
)
def test_bad_input_is_one_clear_line(arguments, options, message):
    with pytest.raises(ValueError, match=message) as caught:
        absolute_trajectory_error(*arguments, **options)
    assert "\n" not in str(caught.value)


def test_one_pose_is_enough_without_a_rotation_to_fit():
    error = absolute_trajectory_error(STAMPS, LINE, STAMPS[:1], LINE[:1] + 1, align="first_pose")
    assert (error.n, error.max_m) == (1, 0.0)


@pytest.mark.parametrize(
    ("delta", "unit", "message"),
    [
        (0, "frames", "delta is 0"),
        (1.5, "frames", "give a whole number"),
        (10.0, "meters", "spans only 3.000"),
        (np.nan, "seconds", "delta is nan"),
    ],
)
def test_bad_delta_is_one_clear_line(delta, unit, message):
    with pytest.raises(ValueError, match=message):
        relative_pose_error(STAMPS, LINE, STAMPS, LINE, delta=delta, unit=unit)
