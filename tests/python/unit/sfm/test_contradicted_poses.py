"""Matches that contradict a model: an image gets no pose that most of its own deny, others are told of."""

from __future__ import annotations

import numpy as np
import pytest

import sfmcpp
from sfm_scenes import match_graph
from sfmcpp.geometry import so3, two_view_geometry
from sfmcpp.model import Problem
from sfmcpp.model.photos import Features, Photo
from sfmcpp.sfm import MatchGraph, Pair, reconstruct

WRONG = 60


def features_at(pixels: np.ndarray) -> Features:
    unknown = np.full(len(pixels), np.nan)
    return Features(
        pixels, unknown, unknown, np.zeros((len(pixels), 3), np.uint8), np.zeros((len(pixels), 0), np.uint8)
    )


def with_turned_camera(graph: MatchGraph, truth: Problem, turned: int) -> MatchGraph:
    """With one more image, taken where image 0 was, which shows nothing of the scene.

    It shares `turned` features with image 0 alone. Others look like features of image 5, as a window like
    another, and so they match those of images 4 and 6.
    """
    random, row = np.random.default_rng(6), truth.intrinsics[0]
    before, window = graph.features[0].pixels, graph.features[5].pixels[:WRONG]
    seen = random.uniform(60, 420, (turned, 2))
    k = np.array([[row[0], 0, row[2]], [0, row[0], row[3]], [0, 0, 1]])
    moved = np.column_stack([seen, np.ones(turned)]) @ (k @ so3.exp([0.0, 0.05, 0.0]) @ np.linalg.inv(k)).T
    here = np.concatenate([window + random.normal(0, 0.3, window.shape), moved[:, :2] / moved[:, 2:]])
    features = [features_at(np.concatenate([before, seen])), *graph.features[1:], features_at(here)]
    links = {0: np.arange(turned)[:, None] + [len(before), WRONG]}
    for pair in graph.pairs:
        if 5 in (pair.first, pair.second):
            other, matches = (
                (pair.first, pair.verified) if pair.second == 5 else (pair.second, pair.verified[:, ::-1])
            )
            links[other] = np.concatenate([links.get(other, matches[:0]), matches[matches[:, 1] < WRONG]])
    new, pairs = len(graph.photos), list(graph.pairs)
    for image, matches in links.items():
        ends = features[image].pixels[matches[:, 0]], here[matches[:, 1]]
        pairs.append(Pair(image, new, matches.astype(np.int32), two_view_geometry(*ends, row, row)))
    return MatchGraph([*graph.photos, Photo("turned.jpg", size=graph.photos[0].size)], features, pairs)


@pytest.mark.parametrize(("turned", "registered"), [(20, True), (2000, False)])
def test_a_camera_that_turned_away_gets_no_pose_from_a_few_wrong_matches(
    turned: int, registered: bool
) -> None:
    truth = sfmcpp.circle_scene(10, 400, pixel_sigma_px=0.0, seed=4)
    graph = with_turned_camera(match_graph(truth, sigma_px=0.3, reach=2), truth, turned)
    run = reconstruct(graph, camera=1000.0, camera_model="fixed", subpixel=False, gps="none")
    assert all(run.images[photo.name].registered for photo in graph.photos[:-1])
    assert run.images["turned.jpg"].registered == registered
    if not registered:
        assert run.images["turned.jpg"].reason == (
            "its pose contradicts its matches with other images, as 000.jpg"
        )


def with_two_turned_cameras(graph: MatchGraph, truth: Problem, turned: int) -> MatchGraph:
    """Like `with_turned_camera`, but what it shares with image 0 it shares with one more image alone."""
    one, row, new = with_turned_camera(graph, truth, turned), truth.intrinsics[0], len(graph.photos)
    (link,) = (pair for pair in one.pairs if (pair.first, pair.second) == (0, new))
    seen = one.features[0].pixels[link.matches[:, 0]]
    matches = np.column_stack([link.matches[:, 1], np.arange(turned)]).astype(np.int32)
    geometry = two_view_geometry(one.features[new].pixels[matches[:, 0]], seen, row, row)
    pairs = [pair for pair in one.pairs if pair is not link] + [Pair(new, new + 1, matches, geometry)]
    photos = [*one.photos, Photo("other.jpg", size=graph.photos[0].size)]
    return MatchGraph(photos, [*graph.features, one.features[new], features_at(seen)], pairs)


@pytest.mark.parametrize(("turned", "registered"), [(100, True), (8000, False)])
def test_a_camera_that_turned_with_others_gets_no_place_from_a_few_wrong_matches(
    turned: int, registered: bool
) -> None:
    truth = sfmcpp.circle_scene(10, 400, pixel_sigma_px=0.0, seed=4)
    graph = with_two_turned_cameras(match_graph(truth, sigma_px=0.3, reach=2), truth, turned)
    run = reconstruct(graph, camera=1000.0, camera_model="fixed", subpixel=False, gps="none")
    assert all(run.images[photo.name].registered for photo in graph.photos[:-2])
    assert not run.images["other.jpg"].registered
    assert run.images["turned.jpg"].registered == registered
    if not registered:
        assert run.images["turned.jpg"].reason.startswith(
            f"{turned} of its matches are with images of the sa"
        )


def with_a_walker(graph: MatchGraph, truth: Problem, images: list[int], count: int) -> MatchGraph:
    """With `count` matches of image 0 with each of `images`, as if they saw what image 1 does."""
    (near,) = (pair for pair in graph.pairs if (pair.first, pair.second) == (0, 1))
    features, pairs, row = list(graph.features), list(graph.pairs), truth.intrinsics[0]
    seen = graph.features[1].pixels[near.verified[:count, 1]]
    for image in images:
        before = features[image].pixels
        features[image] = features_at(np.concatenate([before, seen]))
        matches = np.column_stack([near.verified[:count, 0], np.arange(count) + len(before)]).astype(np.int32)
        ends = features[0].pixels[matches[:, 0]], seen
        pairs.append(Pair(0, image, matches, two_view_geometry(*ends, row, row)))
    return MatchGraph(graph.photos, features, pairs)


@pytest.mark.parametrize(("images", "count", "told"), [([5], 35, 0), ([5, 6], 35, 1), ([5], 300, 1)])
def test_pairs_that_contradict_a_model_are_told_but_for_a_single_one_of_few_matches(
    images: list[int], count: int, told: int
) -> None:
    truth = sfmcpp.circle_scene(10, 400, pixel_sigma_px=0.0, seed=4)
    graph = with_a_walker(match_graph(truth, sigma_px=0.3, reach=2), truth, images, count)
    run = reconstruct(graph, camera=1000.0, camera_model="fixed", subpixel=False, gps="none")
    found = [text for text in run.warnings if "match well but contradict the model" in text]
    assert len(found) == told
    assert all(text.startswith("2 pairs of images" if len(images) == 2 else "2 images") for text in found)
