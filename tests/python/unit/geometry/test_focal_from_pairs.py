"""The focal length that pairs of photos agree on, against that of the cameras that made them."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from random_scenes import Array, project, random_pair
from sfmcpp import InvalidArgument
from sfmcpp.geometry import focal_from_pairs, two_view_geometry
from sfmcpp.geometry.epipolar import camera_of_fundamental, fundamental_matrix

SIZE = (1000, 750)
NOISE_PX = 0.5


def looking_at(centre: Array, target: Array, roll: float) -> Array:
    forward = (target - centre) / np.linalg.norm(target - centre)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    upright = np.column_stack([right, np.cross(forward, right), forward])
    return np.column_stack([upright @ Rotation.from_rotvec([0, 0, roll]).as_matrix(), centre])


def photos(focal: float, seed: int, kind: str = "around", count: int = 5) -> list[Array]:
    """Pixels of 250 points in each photo; NaN where they are not in it."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-2, 2, (250, 3))
    distance = 8 * focal / SIZE[0]
    images = []
    for k in range(count):
        angle, radius = np.radians(15 * (k - count / 2)), distance * (1 + 0.25 * rng.uniform(-1, 1))
        centre = radius * np.array([np.cos(angle), np.sin(angle), 0.2 * rng.standard_normal()])
        target, roll = rng.uniform(-0.7, 0.7, 3), 0.1 * rng.standard_normal()
        if kind == "turntable":
            centre = distance * np.array([np.cos(angle), np.sin(angle), 0.1])
            target, roll = np.zeros(3), 0.0
        if kind == "parallel":
            centre = np.array([distance, 0.4 * k, 0.3 * rng.standard_normal()])
            target, roll = centre - [1.0, 0, 0], 0.0
        row = np.array([focal, 1.0, SIZE[0] / 2, SIZE[1] / 2, 0.0])
        image = project(looking_at(centre, target, roll), row, points)
        image += NOISE_PX * rng.standard_normal(image.shape)
        image[~((image > 0) & (image < SIZE)).all(axis=1)] = np.nan
        images.append(image)
    return images


def pairs_of(images: list[Array], outliers: int = 0) -> list[tuple[Array, Array]]:
    """What all pairs see in common, with some pairs that match anything with anything before them."""
    rng = np.random.default_rng(0)
    pairs = [(rng.uniform(0, SIZE, (100, 2)), rng.uniform(0, SIZE, (100, 2))) for _ in range(outliers)]
    for first, second in combinations(images, 2):
        common = np.isfinite(first + second).all(axis=1)
        pairs.append((first[common], second[common]))
    return pairs


@pytest.mark.parametrize("focal", [500.0, 900.0, 1600.0, 3000.0])
def test_the_focal_length_is_found_from_short_to_long(focal: float) -> None:
    found = focal_from_pairs(pairs_of(photos(focal, seed=int(focal))), SIZE)
    assert found is not None
    assert abs(np.log(found / focal)) < 0.03


def test_wrong_pairs_do_not_decide() -> None:
    found = focal_from_pairs(pairs_of(photos(1200.0, seed=1), outliers=5), SIZE)
    assert found is not None
    assert abs(np.log(found / 1200.0)) < 0.03


def test_a_pair_of_one_place_says_nothing() -> None:
    pairs = pairs_of(photos(1200.0, seed=1))
    place = np.full((40, 2), 300.0)
    assert focal_from_pairs([*pairs, (place, place)], SIZE) == focal_from_pairs(pairs, SIZE)
    assert focal_from_pairs([(place, place + 5)], SIZE) is None


@pytest.mark.parametrize("kind", ["turntable", "parallel"])
def test_motions_that_leave_the_focal_length_open_give_none(kind: str) -> None:
    assert focal_from_pairs(pairs_of(photos(1200.0, 2, kind)), SIZE) is None


def test_few_matches_or_none_give_none() -> None:
    assert focal_from_pairs([], SIZE) is None
    assert focal_from_pairs([(np.zeros((5, 2)), np.ones((5, 2)))], SIZE) is None


def test_bad_arguments_are_named() -> None:
    with pytest.raises(InvalidArgument, match=r"size = \(0, 5\)"):
        focal_from_pairs([], (0, 5))
    with pytest.raises(InvalidArgument, match=r"pairs\[0\]\[1\]"):
        focal_from_pairs([(np.zeros((40, 2)), np.zeros((39, 2)))], SIZE)


def test_the_camera_of_a_fundamental_matrix_is_the_one_that_made_it() -> None:
    rows = np.array([700.0, 1.1, 310.0, 250.0, 4.0]), np.array([900.0, 0.95, 400.0, 200.0, -2.0])
    for seed in range(10):
        pair = random_pair(seed)
        camera = np.column_stack([pair.camera[:, :3], pair.camera[:, 3] / np.linalg.norm(pair.camera[:, 3])])
        matrix = (-1.0) ** seed * fundamental_matrix(np.eye(3, 4), camera, *rows)
        seen = [project(c, np.array([1.0, 1, 0, 0, 0]), pair.points) for c in (np.eye(3, 4), camera)]
        np.testing.assert_allclose(camera_of_fundamental(matrix, *rows, *seen), camera, atol=1e-9)


def sift_matches(folder: Path) -> list[tuple[Array, Array]]:
    """Mutual matches, better than any second, of all pairs of the first seven photos in a folder."""
    cv2 = pytest.importorskip("cv2")
    found = []
    for path in sorted(folder.glob("*.jpg"))[:7]:
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        keypoints, descriptors = cv2.SIFT_create(nfeatures=1200).detectAndCompute(image, None)
        pixels = np.array([point.pt for point in keypoints]) + 0.5
        found.append((pixels, np.sqrt(descriptors / descriptors.sum(axis=1, keepdims=True))))
    pairs = []
    for (pixels_1, roots_1), (pixels_2, roots_2) in combinations(found, 2):
        likeness = roots_1 @ roots_2.T
        second, best = np.partition(2 - 2 * likeness, 1, axis=1)[:, :2].T[::-1]
        to, back = likeness.argmax(axis=1), likeness.argmax(axis=0)
        good = (back[to] == np.arange(len(to))) & (best < 0.64 * second)
        pairs.append((pixels_1[good], pixels_2[to[good]]))
    return pairs


@pytest.mark.real
def test_photos_without_exif_tell_their_focal_length(data_dir: Path) -> None:
    if not (data_dir / "kermit").is_dir():
        pytest.skip("photos of kermit not found")
    pairs = []
    for first, second in sift_matches(data_dir / "kermit"):
        geometry = two_view_geometry(first, second)
        if geometry.kind == "general":
            pairs.append((first[geometry.inliers], second[geometry.inliers]))
    found = focal_from_pairs(pairs, (640, 480))
    assert found is not None
    # Bundler's own result for these photos has focal lengths from 637 to 729 px, 700 in the median.
    assert abs(np.log(found / 700)) < 0.06
