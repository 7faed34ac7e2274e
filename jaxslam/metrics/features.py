"""Feature matching between two maps drawn as images: the map measure of Jamaludin et al."""

import warnings
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64

from jaxslam.metrics.map import BinaryMap

_BLUR = 2.0
"""Standard deviation, cells: without blur, the detector finds only the corners of single cells."""
_NUM_FEATURES = 500
_NUM_TRIALS = 2000
_SAMPLE = 2


@dataclass(frozen=True)
class FeatureMatch:
    """Result of feature matching.

    Attributes:
        inliers: number of matches that agree on one rigid motion.
        matches: number of pairs of features with similar descriptors.
        features: number of features in the reference and in the estimate.
        pose: `[3]` motion of the estimate onto the reference (m, m, rad); NaN if too few features match.
    """

    inliers: int
    matches: int
    features: tuple[int, int]
    pose: Float64[np.ndarray, "3"]


def match_features(
    reference: BinaryMap, estimate: BinaryMap, *, tolerance: float = 0.25, seed: int = 0
) -> FeatureMatch:
    """Match ORB features of two maps and find the rigid motion that explains most matches.

    The number of inliers falls with every map error: noise, double walls, bent walls. It rises with the size
    of the map and with artifacts of the lidar that both maps share. Therefore only compare maps of one place
    with one reference, and use a reference of the same kind. Needs scikit-image, the extra `vision`.

    Args:
        reference: the true map, preferably built from known poses: a drawing has other corners than a map.
        estimate: a map with cells of the same size.
        tolerance: largest distance of matched features after the motion, meters.
        seed: seed of RANSAC.

    Raises:
        ValueError: the cells of the maps differ in size.

    References:
        Rublee et al., ORB: an efficient alternative to SIFT or SURF, ICCV 2011; Fischler and Bolles 1981.
    """
    from skimage.feature import match_descriptors
    from skimage.measure import ransac
    from skimage.transform import EuclideanTransform

    if not np.isclose(reference.resolution, estimate.resolution, rtol=1e-4):
        raise ValueError(
            f"cells of {reference.resolution:g} m and of {estimate.resolution:g} m: give maps with cells of "
            "the same size"
        )
    (places_reference, described_reference), (places, described) = map(_features, (reference, estimate))
    nothing = np.full(3, np.nan)
    counts = len(places_reference), len(places)
    if not min(counts):
        return FeatureMatch(0, 0, counts, nothing)
    pairs = match_descriptors(described_reference, described, cross_check=True)
    if len(pairs) <= _SAMPLE:
        return FeatureMatch(0, len(pairs), counts, nothing)
    to, of = places_reference[pairs[:, 0]], places[pairs[:, 1]]
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "No inliers found")  # the result has 0 inliers
        model, inliers = ransac(
            (of, to), EuclideanTransform, _SAMPLE, tolerance, max_trials=_NUM_TRIALS, rng=seed
        )
    if model is None or inliers is None or not np.any(inliers):
        return FeatureMatch(0, len(pairs), counts, nothing)
    pose = np.array([*model.translation, model.rotation], np.float64)
    return FeatureMatch(int(np.count_nonzero(inliers)), len(pairs), counts, pose)


def _features(known: BinaryMap) -> tuple[Float64[np.ndarray, "F 2"], Bool[np.ndarray, "F D"]]:
    """Return positions `[F, 2]` (meters, world frame) and descriptors of the features of a blurred map."""
    from skimage.feature import ORB
    from skimage.filters import gaussian

    levels = np.where(known.occupied, 0.0, np.where(known.free, 1.0, 0.5)).astype(np.float32)
    detector = ORB(n_keypoints=_NUM_FEATURES, fast_threshold=0.05)
    try:
        detector.detect_and_extract(gaussian(levels, _BLUR, preserve_range=True))
    except RuntimeError:  # scikit-image finds no feature
        return np.zeros((0, 2)), np.zeros((0, 256), bool)
    rows_columns = np.asarray(detector.keypoints, np.float64)
    places = (rows_columns[:, ::-1] + 0.5) * known.resolution + np.asarray(known.origin, np.float64)
    return places, np.asarray(detector.descriptors, bool)
