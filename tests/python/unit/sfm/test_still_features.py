"""What stands still in the images while the scene moves is left out of a match graph."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import sfmcpp
from sfm_scenes import SIZE, match_graph
from sfmcpp.geometry import two_view_geometry
from sfmcpp.model.photos import Features
from sfmcpp.sfm import MatchGraph, Pair
from sfmcpp.sfm.front_end import FrontEndSettings
from sfmcpp.sfm.still_features import without_still_features

IMAGES = 8


def scene(seed: int = 4) -> MatchGraph:
    return match_graph(sfmcpp.circle_scene(IMAGES, 200, seed=seed), sigma_px=0.3, reach=3, known=False)


def with_frame(graph: MatchGraph, images: int, count: int, move_px: float = 0.0) -> MatchGraph:
    """With `count` features more in the same place of the first `images`, which all their pairs match."""
    random = np.random.default_rng(7)
    places = random.uniform(0, 1, (count, 2)) * SIZE
    features = []
    for image, before in enumerate(graph.features):
        pixels = places + random.normal(0, 0.15, places.shape) + move_px * image
        colors = np.concatenate([before.colors, np.zeros((count, 3), np.uint8)])
        unknown = np.full(len(colors), np.nan)
        bytes_ = np.zeros((len(colors), 0), np.uint8)
        features.append(Features(np.concatenate([before.pixels, pixels]), unknown, unknown, colors, bytes_))
    pairs = [_framed(pair, graph, features, count) if pair.second < images else pair for pair in graph.pairs]
    return replace(graph, features=features, pairs=pairs)


def _framed(pair: Pair, graph: MatchGraph, features: list[Features], count: int) -> Pair:
    ends = [pair.first, pair.second]
    more = np.arange(count)[:, None] + [len(graph.features[k]) for k in ends]
    matches = np.concatenate([pair.matches, more]).astype(np.int32)
    first, second = (features[k].pixels[column] for k, column in zip(ends, matches.T, strict=True))
    return replace(pair, matches=matches, geometry=two_view_geometry(first, second, None, None, seed=0))


def left(graph: MatchGraph) -> tuple[MatchGraph, list[str]]:
    return without_still_features(graph, [None] * len(graph.photos), FrontEndSettings())


def test_a_frame_with_more_features_than_the_scene_is_left_out_and_told() -> None:
    graph = scene()
    framed = with_frame(graph, IMAGES, 1200)
    assert not any(pair.geometry.kind == "general" for pair in framed.pairs)
    found, told = left(framed)
    for one, other in zip(found.pairs, graph.pairs, strict=True):
        assert one.geometry.kind == other.geometry.kind == "general"
        assert len(one.matches) > 0.97 * len(other.matches)
        assert (one.matches < 200).all()
    assert len(told) == 1
    assert f"1200 features each of {IMAGES} images stand still" in told[0]


def test_what_stands_still_in_few_images_or_moves_stays() -> None:
    for graph in (
        scene(),
        with_frame(scene(), IMAGES // 2, 1200),
        with_frame(scene(), IMAGES, 1200, move_px=2.0),
    ):
        found, told = left(graph)
        assert found is graph
        assert not told


def test_a_camera_that_stood_still_keeps_its_matches() -> None:
    graph = scene()
    only = with_frame(
        replace(graph, pairs=[replace(p, matches=p.matches[:5]) for p in graph.pairs]), IMAGES, 1200
    )
    found, told = left(only)
    assert found is only
    assert not told
