"""Cameras with few images each, as of zoom lenses and collections of photos."""

from __future__ import annotations

import numpy as np
import pytest

import sfmcpp
from sfm_scenes import match_graph
from sfmcpp.geometry import fit_similarity
from sfmcpp.model.camera_models import PERSPECTIVE
from sfmcpp.sfm import SfmRun, reconstruct
from sfmcpp.study import SfmReport

K1 = -0.15


def scene(k1: float) -> sfmcpp.Problem:
    """Points that fill the images, whose corners a lens of `k1` moves by some 20 px."""
    options = {"camera_model": "perspective", "distortion": (k1, 0.0), "seed": 4}
    return sfmcpp.circle_scene(12, 600, cube_m=14.0, focal_px=700, pixel_sigma_px=0, **options)


@pytest.fixture(scope="module")
def truth() -> sfmcpp.Problem:
    return scene(K1)


def run_of(truth: sfmcpp.Problem, sharing: str) -> SfmRun:
    graph = match_graph(truth, sigma_px=0.3, known=False)
    return reconstruct(graph, camera=700.0, shared_camera=sharing)


def centre_error(run: SfmRun, truth: sfmcpp.Problem) -> float:
    assert run.model is not None
    world = run.models[0]
    assert world.registered.all()
    centres = fit_similarity(world.poses[:, :, 3], truth.centres).apply(world.poses[:, :, 3])
    return float(np.linalg.norm(centres - truth.centres, axis=1).mean())


def test_the_distortion_of_images_with_a_camera_each_does_not_bend_the_model(truth: sfmcpp.Problem) -> None:
    bent, straight = run_of(truth, "each"), run_of(scene(0.0), "each")
    k1 = bent.models[0].intrinsics[:, PERSPECTIVE.index("k1")]
    assert np.abs(k1 - K1).max() < 0.01
    assert centre_error(bent, truth) < 2 * centre_error(straight, truth)


def test_a_report_says_what_was_estimated_of_a_camera_with_few_images(truth: sfmcpp.Problem) -> None:
    cameras = SfmReport(run_of(truth, "each")).to_dict()["cameras"]
    assert [camera["images"] for camera in cameras] == [1] * 12
    assert {tuple(camera["refined"]) for camera in cameras} == {("f", "k1")}
    assert {tuple(camera["sigma"]) for camera in cameras} == {("f", "k1")}
