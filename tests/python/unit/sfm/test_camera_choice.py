"""Which intrinsics a model frees, against scenes of known cameras."""

from __future__ import annotations

import numpy as np
import pytest

import sfmcpp
from sfm_scenes import SIZE, match_graph
from sfmcpp.map import Map
from sfmcpp.model import Problem
from sfmcpp.model.camera_models import PERSPECTIVE
from sfmcpp.sfm.camera_choice import choose_camera_model
from sfmcpp.sfm.cameras import cameras_of
from sfmcpp.sfm.incremental import grow_models
from sfmcpp.sfm.scene import Scene
from sfmcpp.sfm.settings import IncrementalSettings

CENTRE = np.array(SIZE) / 2
PRINCIPAL_POINT = [PERSPECTIVE.index("cx"), PERSPECTIVE.index("cy")]


def grown_world(truth: Problem, offset_px: tuple[float, float] = (0.0, 0.0)) -> Map:
    """Simple cameras of a scene, where the principal point is off the centre of the images."""
    truth.pixels += CENTRE + offset_px - truth.intrinsics[0, 2:4]
    truth.intrinsics[:, 2:4] = CENTRE + offset_px
    graph = match_graph(truth, sigma_px=0.4, reach=truth.num_cameras)
    cameras = cameras_of(graph.photos, model="simple-radial", focal_px=1000.0, sharing="one")
    (world,) = grow_models(Scene.of(graph, cameras), IncrementalSettings(), lambda _: False).models
    return world


def circle() -> Problem:
    return sfmcpp.circle_scene(10, 200, pixel_sigma_px=0.0, seed=4)


def sphere() -> Problem:
    return sfmcpp.sphere_scene(14, 250, pixel_sigma_px=0.0, radius_m=12.0, seed=4)


def test_a_principal_point_off_the_centre_is_found() -> None:
    world = grown_world(sphere(), (9.0, -6.0))
    choose_camera_model(world, IncrementalSettings())
    assert world.camera_names == ["SIMPLE_RADIAL"]
    assert not world.fixed_intrinsics[0, PRINCIPAL_POINT].any()
    assert world.fixed_intrinsics[0, PERSPECTIVE.index("aspect")]
    assert world.intrinsics[0, PRINCIPAL_POINT] == pytest.approx(CENTRE + np.array([9.0, -6.0]), abs=1.5)


@pytest.mark.parametrize(
    ("truth", "offset_px"),
    [
        pytest.param(sphere(), (0.0, 0.0), id="it is there"),
        pytest.param(circle(), (9.0, -6.0), id="a circle leaves it open"),
    ],
)
def test_it_stays_at_the_centre(truth: Problem, offset_px: tuple[float, float]) -> None:
    world = grown_world(truth, offset_px)
    choose_camera_model(world, IncrementalSettings())
    assert world.fixed_intrinsics[0, PRINCIPAL_POINT].all()
    assert np.array_equal(world.intrinsics[0, PRINCIPAL_POINT], CENTRE)


def test_cameras_that_were_chosen_before_keep_their_name() -> None:
    world = grown_world(circle())
    world.fixed_intrinsics[:, PERSPECTIVE.index("k2")] = False
    choose_camera_model(world, IncrementalSettings())
    assert world.camera_names == ["RADIAL"]
