"""What stands still in the images while the scene moves is left out of a match graph."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import sfmcpp
from sfm_scenes import SIZE, match_graph
from sfmcpp.geometry import two_view_geometry
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.photos import Features
from sfmcpp.sfm import MatchGraph, Pair, reconstruct
from sfmcpp.sfm.front_end import FrontEndSettings
from sfmcpp.sfm.still_features import without_still_features

IMAGES = 8


def scene(seed: int = 4) -> MatchGraph:
    return match_graph(sfmcpp.circle_scene(IMAGES, 200, seed=seed), sigma_px=0.3, reach=3, known=False)


def with_frame(graph: MatchGraph, images: int, count: int, move_px: float = 0.0) -> MatchGraph:
    """With `count` features more in the same place at the border, see `with_still`."""
    places = np.random.default_rng(7).uniform(0, 1, (count, 2))
    side = np.arange(count) % 2
    places[np.arange(count), side] = 0.15 * places[np.arange(count), side] + 0.85 * (np.arange(count) % 4 > 1)
    return with_still(graph, images, places * SIZE, move_px)


def with_background(graph: MatchGraph, images: int, count: int) -> MatchGraph:
    """With `count` features more in the same place anywhere, see `with_still`."""
    return with_still(graph, images, np.random.default_rng(7).uniform(0, 1, (count, 2)) * SIZE)


def with_still(graph: MatchGraph, images: int, places: FloatArray, move_px: float = 0.0) -> MatchGraph:
    """With features more at `places` (n, 2) of the first `images`, which all their pairs match."""
    random, count = np.random.default_rng(7), len(places)
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


def test_a_camera_that_stood_still_keeps_what_stood() -> None:
    graph = scene()
    few = replace(graph, pairs=[replace(p, matches=p.matches[:5]) for p in graph.pairs])
    for before in (few, graph):
        found, told = left(with_background(before, IMAGES, 1200))
        assert {pair.geometry.kind for pair in found.pairs} == {"rotation"}
        assert all((pair.matches >= 200).mean() > 0.99 for pair in found.pairs)
        assert all(pair.num_verified > 1150 for pair in found.pairs)
        assert not told
        run = reconstruct(found)
        assert not run.models
        why = "no model: the camera did not move between these images; move it between photos"
        assert run.warnings == [why]


def test_what_passes_before_a_camera_that_stood_is_left_out_between_its_images_alone() -> None:
    graph = scene()
    found, told = left(with_background(graph, 6, 1200))
    for pair, before in zip(found.pairs, graph.pairs, strict=True):
        stood = pair.second < 6
        assert pair.geometry.kind == ("rotation" if stood else "general")
        assert stood or len(pair.matches) == len(before.matches)
    assert len(told) == 1
    assert f"the camera did not move between 6 of {IMAGES} images" in told[0]
