"""Images that look alike, found among many: rings of landmarks, and photos."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from looks import features_of, ring_distance, walk_round
from sfmcpp.errors import InvalidArgument
from sfmcpp.model.photos import Features
from sfmcpp.sources.vision import match
from sfmcpp.sources.vision.retrieval import alike_pairs, bags_of_words, train_vocabulary

PLACES = 50


@pytest.fixture(scope="module")
def ring() -> list[Features]:
    return walk_round(PLACES, seen=200, step=50)


def test_images_of_one_place_are_paired_and_others_are_not(ring: list[Features]) -> None:
    found = alike_pairs(ring, 6)
    common = {(i, j) for i, j in combinations(range(PLACES), 2) if ring_distance(i, j, PLACES) <= 3}
    assert set(found) == common
    assert found == sorted(found)


def test_words_alone_rank_those_with_something_in_common_first(ring: list[Features]) -> None:
    words = bags_of_words(ring)
    scores = (words @ words.T).toarray()
    np.testing.assert_allclose(np.diag(scores), 1.0)
    np.fill_diagonal(scores, 0.0)
    best = np.argsort(-scores, axis=1)[:, :6]
    common = [ring_distance(i, int(j), PLACES) <= 3 for i in range(PLACES) for j in best[i]]
    assert np.mean(common) >= 0.95


def test_a_repeated_texture_does_not_outweigh_what_is_common() -> None:
    ring = walk_round(20, seen=120, step=60)
    texture = np.full((100, 128), 45, np.uint8)
    burdened = {0, 7, 14}
    images = [
        features_of(np.vstack([image.descriptors, texture])) if k in burdened else image
        for k, image in enumerate(ring)
    ]
    words = bags_of_words(images)
    scores = (words @ words.T).toarray()
    assert scores[0, 1] > scores[0, 7]
    assert scores[0, 19] > scores[0, 14]


@pytest.mark.parametrize("asked", [1, 3, 30, 100])
def test_a_stop_is_heeded_while_words_are_taught_and_found_and_while_matches_are_counted(
    ring: list[Features], asked: int
) -> None:
    """There are 4 passes, 50 images, and some hundred pairs that are tried."""
    heeded: list[None] = []

    def heed() -> None:
        heeded.append(None)
        if len(heeded) == asked:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        alike_pairs(ring, 6, heed=heed)
    assert len(heeded) == asked


def test_only_what_is_asked_for_and_not_known_is_found(ring: list[Features]) -> None:
    known = {(9, 10), (10, 11)}
    found = alike_pairs(ring, 4, queries=[10], known=known)
    assert set(found) == {(7, 10), (8, 10), (10, 12), (10, 13)}


def test_seed_and_threads(ring: list[Features]) -> None:
    found = alike_pairs(ring[:20], 3, seed=4, threads=1)
    assert alike_pairs(ring[:20], 3, seed=4, threads=3) == found
    first, second = (bags_of_words(ring[:20], seed=seed) for seed in (4, 5))
    assert first.shape != second.shape or (first != second).nnz > 0


def test_images_without_features_are_left_alone(ring: list[Features]) -> None:
    nothing = features_of(np.zeros((0, 0), np.uint8))
    found = alike_pairs([nothing, *ring[:6], nothing], 5)
    assert found
    assert {k for pair in found for k in pair} <= set(range(1, 7))
    assert alike_pairs([nothing, nothing], 5) == []
    assert alike_pairs([], 5) == []


def test_descriptors_of_different_length_are_refused(ring: list[Features]) -> None:
    with pytest.raises(InvalidArgument, match="different length"):
        alike_pairs([ring[0], features_of(np.zeros((3, 64), np.uint8))], 1)


def test_means_are_those_of_clusters_far_apart() -> None:
    rng = np.random.default_rng(3)
    centres = rng.integers(20, 230, (8, 128))
    members = np.repeat(centres, 60, axis=0) + rng.integers(-9, 10, (480, 128))
    # Every mean lies in one of the clusters, as two of 60 means in one leave none empty.
    words = train_vocabulary(members.astype(np.uint8), 60, seed=1)
    distance = np.linalg.norm(words[:, None].astype(float) - centres[None], axis=2)
    assert (distance.min(axis=1) < 100).all()
    assert len(set(distance.argmin(axis=1))) == 8
    whole = train_vocabulary(members.astype(np.uint8), 1)
    np.testing.assert_array_equal(whole[0], np.rint(members.mean(axis=0)))


def test_equal_descriptors_are_one_word() -> None:
    assert len(train_vocabulary(np.tile(np.arange(128, dtype=np.uint8), (50, 1)), 10)) == 1


@pytest.mark.real
@pytest.mark.parametrize(
    ("folder", "every", "width", "near"),
    [("fountain_p11/images", 1, 768, 1), ("kitti_clip", 3, 620, 2)],
)
def test_photos_are_paired_with_those_that_show_the_same(
    data_dir: Path, folder: str, every: int, width: int, near: int
) -> None:
    """Truth: the order in which the photos were taken, and matches of all their features."""
    detect = _sift(width)
    photos = sorted(p for p in (data_dir / folder).rglob("*") if p.suffix in (".jpg", ".png"))[::every]
    features = [detect(photo) for photo in photos]
    found = set(alike_pairs(features, 6))
    assert {(k, k + d) for d in range(1, near + 1) for k in range(len(photos) - d)} <= found
    count = {
        pair: len(match(features[pair[0]].descriptors, features[pair[1]].descriptors))
        for pair in combinations(range(len(photos)), 2)
    }
    most = sorted(count, key=lambda pair: -count[pair])[: 2 * len(photos)]
    assert len(found.intersection(most)) >= 0.95 * len(most)


def _sift(width: int) -> Callable[[Path], Features]:
    cv2 = pytest.importorskip("cv2")

    def detect(photo: Path) -> Features:
        image = cv2.imread(str(photo), cv2.IMREAD_GRAYSCALE)
        size = (width, round(image.shape[0] * width / image.shape[1]))
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        keypoints, values = cv2.SIFT_create(nfeatures=1000).detectAndCompute(image, None)
        roots = 512 * np.sqrt(values / values.sum(axis=1, keepdims=True))
        features = features_of(np.rint(roots).clip(0, 255).astype(np.uint8))
        scales = np.array([keypoint.size / 2 for keypoint in keypoints])
        return Features(features.pixels, scales, features.angles, features.colors, features.descriptors)

    return detect


def test_a_vocabulary_does_not_depend_on_how_its_descriptors_lie_in_memory() -> None:
    rows = np.random.default_rng(0).integers(0, 256, (80, 16)).astype(np.uint8)
    expected = train_vocabulary(rows, 6, seed=1)
    for stored in (np.asfortranarray(rows), np.repeat(rows, 2, axis=0)[::2]):
        np.testing.assert_array_equal(train_vocabulary(stored, 6, seed=1), expected)
