"""Focal lengths that the images do not determine: held where they are known, and told by a warning."""

from __future__ import annotations

import numpy as np
import pytest

import sfmcpp
from flights import flight
from sfm_scenes import match_graph
from sfmcpp.ba import residuals_px
from sfmcpp.model import Problem
from sfmcpp.sfm import SfmRun, reconstruct

TOLD = 0.9  # of the true one


def strip() -> Problem:
    """One strip, straight down, over nearly flat ground."""
    random = np.random.default_rng(3)
    truth = flight(np.column_stack([np.arange(6) * 12.0, random.normal(0, 0.3, 6)]), seed=5)
    truth.points[:, 2] *= 0.05
    truth.pixels[:] -= residuals_px(truth)  # what the cameras see there is elsewhere
    return truth


def run_of(truth: Problem, **options: str) -> SfmRun:
    graph = match_graph(truth, sigma_px=0.3, reach=2)
    return reconstruct(graph, camera=TOLD * truth.intrinsics[0, 0], subpixel=False, gps="none", **options)  # type: ignore[arg-type]


def warnings_of_focals(run: SfmRun) -> list[str]:
    return [text for text in run.warnings if "do not determine the focal length" in text]


def test_one_strip_leaves_the_focal_length_where_it_was_told() -> None:
    run = run_of(strip())
    assert run.num_registered == 6
    assert run.model is not None
    assert run.model.intrinsics[0, 0] == 450
    assert run.model.camera_names == ["SIMPLE_RADIAL"]
    (warning,) = warnings_of_focals(run)
    assert "held at 450 px" in warning
    assert "--camera K.txt" in warning


@pytest.mark.parametrize("model", ["simple-pinhole", "radial"])
def test_a_model_that_was_asked_for_is_estimated_and_warned_of(model: str) -> None:
    run = run_of(strip(), camera_model=model)
    assert run.model is not None
    assert run.model.intrinsics[0, 0] != 450
    (warning,) = warnings_of_focals(run)
    assert "estimated as" in warning


def test_views_from_all_sides_determine_it() -> None:
    run = run_of(sfmcpp.circle_scene(10, 400, pixel_sigma_px=0.0, seed=4))
    assert run.num_registered == 10
    assert not warnings_of_focals(run)
    assert run.model is not None
    assert not run.model.fixed_intrinsics[0, 0]


@pytest.mark.parametrize(("factor", "warned"), [(1.0, False), (1.3, True)])
def test_a_held_focal_length_that_the_images_contradict_is_warned_of(factor: float, warned: bool) -> None:
    truth = sfmcpp.circle_scene(10, 400, pixel_sigma_px=0.0, seed=4)
    graph = match_graph(truth, sigma_px=0.3, reach=2)
    run = reconstruct(
        graph, camera=factor * truth.intrinsics[0, 0], camera_model="fixed", subpixel=False, gps="none"
    )
    assert run.num_registered == 10
    text = "\n".join(run.warnings)
    assert ("the camera as given: the fixed f = 1300 px contradicts the images" in text) == warned
