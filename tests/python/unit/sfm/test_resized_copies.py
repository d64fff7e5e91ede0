"""Smaller copies of photos, and those without distortion, are left out of a match graph, by name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import sfmcpp
from sfm_scenes import SIZE, match_graph
from sfmcpp.geometry import two_view_geometry
from sfmcpp.geometry.pinhole import to_pixels
from sfmcpp.sfm import MatchGraph, Pair
from sfmcpp.sfm.resized_copies import without_resized_copies

HALF = (SIZE[0] // 2, SIZE[1] // 2)


def with_copy(graph: MatchGraph, of: int, size: tuple[int, int], shift_px: float = 0.0) -> MatchGraph:
    """With one more photo in front, of the same keypoints at another size."""
    copied = graph.features[of]
    pixels = copied.pixels * (np.array(size) / SIZE) + [shift_px, 0]
    pixels = pixels + np.random.default_rng(2).normal(0, 0.2, pixels.shape)
    same = np.tile(np.arange(len(pixels), dtype=np.int32)[:, None], (1, 2))
    pairs = [replace(pair, first=pair.first + 1, second=pair.second + 1) for pair in graph.pairs]
    pairs.append(Pair(0, of + 1, same, two_view_geometry(pixels, copied.pixels, None, None, seed=0)))
    return MatchGraph(
        [replace(graph.photos[of], name="small.jpg", size=size), *graph.photos],
        [replace(copied, pixels=pixels), *graph.features],
        pairs,
    )


def scene() -> MatchGraph:
    return match_graph(sfmcpp.circle_scene(6, 200, pixel_sigma_px=0.0, seed=4), reach=2)


def test_a_smaller_copy_is_left_out_and_the_rest_is_as_without_it() -> None:
    graph = scene()
    found, copies = without_resized_copies(with_copy(graph, of=2, size=HALF))
    assert copies == {"small.jpg": "002.jpg"}
    assert [photo.name for photo in found.photos] == [photo.name for photo in graph.photos]
    assert [(pair.first, pair.second) for pair in found.pairs] == [(p.first, p.second) for p in graph.pairs]
    for one, other in zip(found.features, graph.features, strict=True):
        np.testing.assert_array_equal(one.pixels, other.pixels)


def test_a_photo_of_another_size_from_nearby_and_one_of_the_same_size_stay() -> None:
    for graph in (with_copy(scene(), of=2, size=HALF, shift_px=3.0), with_copy(scene(), of=2, size=SIZE)):
        found, copies = without_resized_copies(graph)
        assert found is graph
        assert not copies


WIDER = (SIZE[0] + 24, SIZE[1] + 16)


def with_undistorted(graph: MatchGraph, name: str, of: int, parallax_px: float = 0.0) -> MatchGraph:
    """With image 2 as a lens distorts it, and image `of` of another folder without that distortion."""
    f, (width, height) = 1.1 * max(SIZE), SIZE
    lens = np.array([f, 1, width / 2 + 4, height / 2 - 3, 0, -0.2, 0.1, -0.02, 0, 0, 1e-3, -1e-3])
    flat, seen = graph.features[of].pixels, graph.features[2].pixels
    rays = (seen - np.array(SIZE) / 2) / f
    features = list(graph.features)
    features[2] = replace(features[2], pixels=to_pixels(rays, lens))
    count = min(len(flat), len(seen))
    moved = flat[:count] + (np.array(WIDER) - SIZE) / 2
    moved[:, 0] += parallax_px * np.arange(count) / count
    same = np.tile(np.arange(count, dtype=np.int32)[:, None], (1, 2))
    geometry = two_view_geometry(features[2].pixels[:count], moved, None, None, seed=0)
    last = len(graph.photos)
    return MatchGraph(
        [*graph.photos, replace(graph.photos[of], name=name, size=WIDER)],
        [*features, replace(graph.features[of], pixels=moved)],
        [*graph.pairs, Pair(2, last, same, geometry)],
    )


@pytest.mark.parametrize("name", ["dense/images/002.jpg", "dense/images/002.png"])
def test_a_copy_without_distortion_is_left_out(name: str) -> None:
    graph = scene()
    found, copies = without_resized_copies(with_undistorted(graph, name, of=2))
    assert copies == {name: "002.jpg"}
    assert [photo.name for photo in found.photos] == [photo.name for photo in graph.photos]


@pytest.mark.parametrize(
    ("name", "of", "parallax_px"),
    [("dense/003.jpg", 2, 0.0), ("other/002.jpg", 3, 0.0), ("other/002.jpg", 2, 20.0)],
)
def test_other_views_and_other_names_stay(name: str, of: int, parallax_px: float) -> None:
    graph = with_undistorted(scene(), name, of, parallax_px)
    assert without_resized_copies(graph) == (graph, {})
