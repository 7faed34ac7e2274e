import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from jaxslam.metrics import BinaryMap, map_score

ORIGIN = np.zeros(2)


def drawn(picture: str, resolution: float = 1.0, origin=ORIGIN) -> BinaryMap:
    """A map from text: # occupied, . free, space unknown; the last line is row 0."""
    rows = [list(line) for line in reversed(picture.strip("\n").split("\n"))]
    cells = np.array(rows)
    return BinaryMap(cells == "#", cells == ".", resolution, np.asarray(origin, float))


REFERENCE = """
#####
#...#
#...#
#...#
#####
"""
# One wall cell missing, one moved inwards, one invented.
ESTIMATE = """
##.##
#.#.#
#...#
#..##
##.##
"""


def test_five_by_five_without_tolerance():
    score = map_score(drawn(REFERENCE), drawn(ESTIMATE))
    # Reference 16 occupied, estimate 16, shared 14, union 18; free 9 and 9, shared 7, union 11.
    assert (score.n_reference, score.n_estimate) == (16, 16)
    assert score.precision == pytest.approx(14 / 16)
    assert score.recall == pytest.approx(14 / 16)
    assert score.f1 == pytest.approx(14 / 16)
    assert score.iou == pytest.approx(14 / 18)
    assert score.free_iou == pytest.approx(7 / 11)


def test_five_by_five_with_one_cell_of_tolerance():
    score = map_score(drawn(REFERENCE), drawn(ESTIMATE), tolerance_m=1.0)
    # Every cell now has an occupied neighbor in the other map.
    assert (score.precision, score.recall, score.iou) == (1.0, 1.0, 1.0)
    assert score.free_iou == pytest.approx(7 / 11)


def test_docstring_example():
    score = map_score(drawn("###.."), drawn("##..#"))
    assert score.precision == pytest.approx(2 / 3)
    assert score.recall == pytest.approx(2 / 3)
    assert score.iou == pytest.approx(2 / 4)


def test_missing_and_extra_cells_go_to_recall_and_precision():
    score = map_score(drawn("####."), drawn("#...#"))
    assert score.precision == pytest.approx(1 / 2)
    assert score.recall == pytest.approx(1 / 4)
    assert score.f1 == pytest.approx(1 / 3)
    assert score.iou == pytest.approx(1 / 5)


def random_map(seed: int, shape=(40, 50), density=0.04, resolution=0.05, origin=ORIGIN):
    rng = np.random.default_rng(seed)
    occupied = rng.random(shape) < density
    return BinaryMap(occupied, ~occupied, resolution, np.asarray(origin, float))


@pytest.mark.parametrize("tolerance", [0.05, 0.1, 0.15, 0.2501])
@pytest.mark.parametrize("resolution", [0.05, float(np.float32(0.05))])
def test_tolerance_is_euclidean_distance(tolerance, resolution):
    reference, estimate = (random_map(seed, resolution=resolution) for seed in (0, 1))
    reach = tolerance / 0.05 + 1e-6
    near_reference = distance_transform_edt(~reference.occupied) <= reach
    near_estimate = distance_transform_edt(~estimate.occupied) <= reach
    score = map_score(reference, estimate, tolerance_m=tolerance)
    assert score.precision == pytest.approx(near_reference[estimate.occupied].mean())
    assert score.recall == pytest.approx(near_estimate[reference.occupied].mean())


def test_iou_is_the_set_measure_at_tolerance_zero():
    reference, estimate = random_map(2, density=0.3), random_map(3, density=0.3)
    shared = (reference.occupied & estimate.occupied).sum()
    union = (reference.occupied | estimate.occupied).sum()
    assert map_score(reference, estimate).iou == pytest.approx(shared / union)


def test_maps_of_other_size_and_origin_are_compared_in_the_world():
    reference = random_map(4)
    window = BinaryMap(
        reference.occupied[5:30, 8:41], reference.free[5:30, 8:41], 0.05, np.array([0.4, 0.25])
    )
    mask = np.zeros(reference.occupied.shape, bool)
    mask[5:30, 8:41] = True
    score = map_score(reference, window, mask=mask)
    assert (score.precision, score.recall, score.free_iou) == (1.0, 1.0, 1.0)


def test_finer_and_coarser_estimates_of_the_same_map():
    reference = random_map(5)
    finer = BinaryMap(
        *(np.kron(cells, np.ones((2, 2), bool)) for cells in (reference.occupied, reference.free)),
        resolution=0.025,
        origin=ORIGIN,
    )
    for one, other in ((reference, finer), (finer, reference)):
        score = map_score(one, other)
        assert (score.iou, score.free_iou) == (1.0, 1.0)


def test_a_known_pose_undoes_a_rotated_frame():
    reference = random_map(6, density=0.02)
    # With row 0 at the bottom this turns the world by +90°, so the pose turns back by −90°.
    rotated = BinaryMap(
        np.rot90(reference.occupied, -1), np.rot90(reference.free, -1), 0.05, np.array([3.0, -7.0])
    )
    height = reference.occupied.shape[0] * 0.05
    # R(−90°)(x, y) = (y, −x) must bring the corner (3, −7) onto the reference's (0, height).
    pose = np.array([7.0, height + 3.0, -np.pi / 2])
    score = map_score(reference, rotated, pose_reference_estimate=pose)
    assert (score.iou, score.free_iou) == (1.0, 1.0)
    assert map_score(reference, rotated).f1 == 0.0


def test_a_slanted_pose_keeps_walls_and_free_space():
    occupied = np.zeros((120, 120), bool)
    occupied[[10, -11], 10:110] = True
    occupied[10:110, [10, -11]] = True
    free = np.zeros_like(occupied)
    free[11:109, 11:109] = True
    truth = BinaryMap(occupied, free, 0.05, np.zeros(2))
    pose = np.array([0.4, -0.2, 0.3])
    # The estimate is the same room seen from a frame turned by 0.3 rad: look its cells up.
    x, y = np.meshgrid(np.arange(160) + 0.5, np.arange(160) + 0.5)
    local = np.stack([x, y], -1) * 0.05 + np.array([-1.0, -2.0])
    turn = np.array([[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]])
    cell = np.floor((local @ turn.T + pose[:2]) / 0.05).astype(int)
    inside = ((cell >= 0) & (cell < 120)).all(-1)
    column, row = np.where(inside[..., None], cell, 0).transpose(2, 0, 1)
    estimate = BinaryMap(
        inside & occupied[row, column], inside & free[row, column], 0.05, np.array([-1.0, -2.0])
    )
    score = map_score(truth, estimate, tolerance_m=0.1, pose_reference_estimate=pose)
    # Two roundings to a cell move a center by less than one cell diagonal, 0.071 m.
    assert (score.precision, score.recall) == (1.0, 1.0)
    # Only cells at the rim can flip: 4 × 98 of 98² cells, at most half of them.
    assert score.free_iou > 1 - 2 * 98 / 98**2
    assert map_score(truth, estimate, tolerance_m=0.1).f1 < 0.5


def test_cells_outside_the_reference_are_wrong_unless_masked():
    reference = drawn("##.")
    estimate = drawn("##.    ##..")
    score = map_score(reference, estimate)
    assert score.precision == pytest.approx(2 / 4)
    assert score.free_iou == pytest.approx(1 / 3)
    masked = map_score(reference, estimate, mask=np.ones((1, 3), bool))
    assert (masked.precision, masked.free_iou) == (1.0, 1.0)


def test_a_wall_just_over_the_border_still_matches_within_the_tolerance():
    score = map_score(drawn("#.", origin=(1, 0)), drawn("#..", origin=(0, 0)), tolerance_m=1.0)
    assert (score.precision, score.recall) == (1.0, 1.0)


def test_mask_leaves_cells_out():
    mask = np.ones((5, 5), bool)
    mask[0] = mask[4] = False
    score = map_score(drawn(REFERENCE), drawn(ESTIMATE), mask=mask)
    # Rows 1–3: reference 6 walls, estimate 8, 6 shared.
    assert (score.n_reference, score.n_estimate) == (6, 8)
    assert score.precision == pytest.approx(6 / 8)
    assert score.recall == 1.0


def test_an_empty_estimate_scores_zero():
    empty = BinaryMap(np.zeros((5, 5), bool), np.zeros((5, 5), bool), 1.0, ORIGIN)
    score = map_score(drawn(REFERENCE), empty, tolerance_m=1.0)
    assert (score.precision, score.recall, score.f1, score.iou, score.free_iou) == (0, 0, 0, 0, 0)


def test_thresholds_make_a_binary_map():
    probability = np.array([[0.1, 0.25, 0.5, 0.65, 0.9, np.nan]])
    binary = BinaryMap.from_probability(probability, 0.05, ORIGIN)
    np.testing.assert_array_equal(binary.free, [[True, False, False, False, False, False]])
    np.testing.assert_array_equal(binary.occupied, [[False, False, False, False, True, False]])


def test_bad_input_is_one_clear_line():
    reference = drawn(REFERENCE)
    nothing = np.zeros((5, 5), bool)
    with pytest.raises(ValueError, match="no occupied cell of the reference map is scored"):
        map_score(reference, reference, mask=nothing)
    with pytest.raises(ValueError, match=r"mask has shape \(2, 2\)"):
        map_score(reference, reference, mask=np.ones((2, 2), bool))
    with pytest.raises(ValueError, match=r"tolerance_m is -0\.1"):
        map_score(reference, reference, tolerance_m=-0.1)
    with pytest.raises(ValueError, match="pose_reference_estimate is"):
        map_score(reference, reference, pose_reference_estimate=np.array([0, np.nan, 0]))
    with pytest.raises(ValueError, match=r"resolution is 0\.0"):
        BinaryMap(nothing, nothing, 0.0, ORIGIN)
    with pytest.raises(ValueError, match="25 cells are both occupied and free"):
        BinaryMap(~nothing, ~nothing, 1.0, ORIGIN)
    with pytest.raises(ValueError, match="occupied has shape"):
        BinaryMap(nothing, nothing[:3], 1.0, ORIGIN)
