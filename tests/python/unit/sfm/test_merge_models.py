"""Two models of one scene that share points become one, or stay two."""

from __future__ import annotations

import copy
from functools import lru_cache

import numpy as np
import pytest

import sfmcpp
from sfm_scenes import match_graph
from sfmcpp.geometry import Similarity, so3
from sfmcpp.map import Map
from sfmcpp.sfm.cameras import cameras_of
from sfmcpp.sfm.incremental import merge_models
from sfmcpp.sfm.scene import Scene
from sfmcpp.sfm.settings import IncrementalSettings

SETTINGS = IncrementalSettings()
MOVE = Similarity(0.4, so3.exp(np.array([0.2, 0.5, -0.9])), np.array([3.0, 1.0, -7.0]))


def two_halves() -> tuple[Map, Map, Map]:
    """The truth as a map, and two maps of its first and last images, which a test may change."""
    whole = true_map()
    return whole, part_of(whole, slice(0, 7)), part_of(whole, slice(5, 12))


@lru_cache
def true_map() -> Map:
    truth = sfmcpp.circle_scene(12, 60, pixel_sigma_px=0.0, seed=3)
    graph = match_graph(truth, sigma_px=0.0, seed=3)
    cameras = cameras_of(graph.photos, calibration=np.append(truth.intrinsics[0, :5], np.zeros(7)))
    scene = Scene.of(graph, cameras)
    whole = scene.new_map()
    whole.poses[:] = truth.cameras
    first_of_track = np.unique(scene.tracks.track, return_index=True)
    point_of_keypoint = np.concatenate([truth.point_index[truth.camera_index == c] for c in range(12)])
    for track, keypoint in zip(*first_of_track, strict=True):
        if track >= 0:
            whole.points[track] = truth.points[point_of_keypoint[keypoint]]
    return whole


def part_of(whole: Map, images: slice) -> Map:
    part = copy.deepcopy(whole)
    outside = np.ones(whole.num_images, dtype=np.bool_)
    outside[images] = False
    part.poses[outside] = np.nan
    return part


def test_a_map_of_another_frame_is_put_in_its_place() -> None:
    whole, first, last = two_halves()
    last.transform(MOVE)
    assert merge_models(first, last, SETTINGS)
    assert first.poses == pytest.approx(whole.poses, abs=1e-6)


def test_wrong_points_do_not_matter() -> None:
    whole, first, last = two_halves()
    last.transform(MOVE)
    wrong = np.flatnonzero(last.known)[::4]
    last.points[wrong] += np.random.default_rng(0).normal(0, 5.0, (len(wrong), 3))
    assert merge_models(first, last, SETTINGS)
    assert first.poses == pytest.approx(whole.poses, abs=1e-6)


def test_cameras_of_added_images_come_with_what_their_model_knows_of_them() -> None:
    first, last = (with_a_camera_for_each_image(part) for part in two_halves()[1:])
    first.intrinsics[7:, 0] *= 1.3  # a guess, where no image of the model has told better
    last.intrinsics[:5, 0] *= 0.8
    before, last.fixed_intrinsics[:] = last.intrinsics.copy(), False
    last.intrinsics[5:7, 5] = 1e-3  # of images of both: what the model had stays
    assert merge_models(first, last, SETTINGS)
    np.testing.assert_array_equal(first.intrinsics[:, 0], before[5:6, 0].repeat(12))
    assert not first.intrinsics[:, 5].any()
    assert first.fixed_intrinsics[:7].all()
    assert not first.fixed_intrinsics[7:].any()


def with_a_camera_for_each_image(part: Map) -> Map:
    result = Map("perspective")
    result.add_cameras(part.intrinsics[part.image_cameras], fixed=part.fixed_intrinsics[part.image_cameras])
    result.join(part, cameras=np.zeros(len(part.intrinsics), dtype=np.int32))
    result.image_cameras[:] = np.arange(part.num_images)
    return result


def test_maps_that_do_not_fit_stay_as_they_are() -> None:
    _, first, last = two_halves()
    last.points[:] = np.random.default_rng(1).permutation(last.points)
    before = first.poses.copy()
    assert not merge_models(first, last, SETTINGS)
    assert np.array_equal(first.poses, before, equal_nan=True)


def test_maps_that_share_nothing_are_not_joined() -> None:
    _, first, last = two_halves()
    last.points[:] = np.nan
    assert not merge_models(first, last, SETTINGS)
