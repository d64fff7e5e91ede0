"""Keypoints that are not pixels of their images: those of copies of another size are doubted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sfmcpp.model.photos import Features, Photo
from sfmcpp.sfm import match_graph_of_arrays
from sfmcpp.sfm.keypoint_checks import warnings_about_keypoints

SIZES = [(640, 480), (480, 640), (640, 480)]


def features_within(sizes: list[tuple[int, int]], count: int = 400, seed: int = 0) -> list[Features]:
    """Keypoints anywhere in images of these sizes."""
    rng = np.random.default_rng(seed)
    unknown, black, nothing = (
        np.full(count, np.nan),
        np.zeros((count, 3), np.uint8),
        np.empty((count, 0), np.uint8),
    )
    return [Features(rng.uniform(0, size, (count, 2)), unknown, unknown, black, nothing) for size in sizes]


def photos_of(sizes: list[tuple[int, int]]) -> list[Photo]:
    return [Photo(f"{i}.jpg", size=size) for i, size in enumerate(sizes)]


def scaled(features: list[Features], factor: float) -> list[Features]:
    return [replace(one, pixels=one.pixels * factor) for one in features]


def test_keypoints_of_their_images_are_not_doubted() -> None:
    assert warnings_about_keypoints(features_within(SIZES), photos_of(SIZES)) == []


@pytest.mark.parametrize("factor", [2.0, 1.25])
def test_keypoints_outside_of_their_images_are_doubted(factor: float) -> None:
    (warning,) = warnings_about_keypoints(scaled(features_within(SIZES), factor), photos_of(SIZES))
    assert "keypoints of 3 of 3 images lie outside of them" in warning


def test_the_image_of_another_size_is_named_with_a_keypoint_outside() -> None:
    features = features_within(SIZES)
    features[1] = replace(features[1], pixels=features[1].pixels[:, ::-1].copy())
    features[1].pixels[7] = [639.0, 5.0]
    (warning,) = warnings_about_keypoints(features, photos_of(SIZES))
    assert all(part in warning for part in ("keypoints of 1 of 3 images", "1.jpg", "in 480 × 640 px"))


@pytest.mark.parametrize("factor", [0.5, 0.7])
def test_keypoints_of_smaller_copies_are_doubted(factor: float) -> None:
    (warning,) = warnings_about_keypoints(scaled(features_within(SIZES), factor), photos_of(SIZES))
    assert f"{factor:.0%} of their width" in warning or f"{factor - 0.01:.0%} of their width" in warning


def test_a_few_keypoints_tell_nothing_of_the_size() -> None:
    few = scaled(features_within(SIZES, count=20), 0.5)
    assert warnings_about_keypoints(few, photos_of(SIZES)) == []


def test_a_match_graph_tells_of_them_where_sizes_are_given() -> None:
    pixels = [one.pixels for one in scaled(features_within(SIZES), 2.0)]
    assert "lie outside" in match_graph_of_arrays(pixels, {}, SIZES).warnings[0]
    assert match_graph_of_arrays(pixels, {}).warnings == []
