"""Focal lengths that the images do not determine: held where they are known, and told by a warning."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import sfmcpp
from flights import flight
from sfm_scenes import match_graph
from sfmcpp import InvalidArgument
from sfmcpp.ba import residuals_px
from sfmcpp.model import Problem
from sfmcpp.sfm import SfmRun, reconstruct
from sfmcpp.sfm.camera_choice import camera_warnings
from sfmcpp.sfm.cameras import parse_camera_argument
from sfmcpp.sfm.focal_lengths import settle_focals_by_images, settle_focals_by_positions
from sfmcpp.sfm.settings import IncrementalSettings

TOLD = 0.9  # of the true one


def strip() -> Problem:
    """One strip, straight down, over nearly flat ground."""
    random = np.random.default_rng(3)
    truth = flight(np.column_stack([np.arange(6) * 12.0, random.normal(0, 0.3, 6)]), seed=5)
    truth.points[:, 2] *= 0.05
    truth.pixels[:] -= residuals_px(truth)  # what the cameras see there is elsewhere
    return truth


def block() -> Problem:
    """Two strips in two heights, straight down, over nearly flat ground."""
    random = np.random.default_rng(3)
    places = np.array([[12.0 * step, 15.0 * row] for row in (0, 1) for step in range(5)])
    truth = flight(places + random.normal(0, 0.5, places.shape), seed=5)
    truth.points[:, 2] *= 0.05
    truth.cameras[5:, 2, 3] += 8.0
    truth.pixels[:] -= residuals_px(truth)
    return truth


def run_of(truth: Problem, gps: str | Path = "none", **options: str) -> SfmRun:
    graph = match_graph(truth, sigma_px=0.3, reach=2)
    return reconstruct(graph, camera=TOLD * truth.intrinsics[0, 0], subpixel=False, gps=gps, **options)  # type: ignore[arg-type]


def table_of(path: Path, truth: Problem, names: list[str], sigma_m: float) -> Path:
    """Positions with errors, as a file of them."""
    rows = truth.centres + np.random.default_rng(8).normal(0, sigma_m, truth.centres.shape)
    cells = (f"{name},{x},{y},{z}" for name, (x, y, z) in zip(names, rows.tolist(), strict=True))
    path.write_text("\n".join(["name,x,y,z", *cells]))
    return path


def warnings_of_focals(run: SfmRun) -> list[str]:
    return [text for text in run.warnings if "not determine the focal length" in text]


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


def test_positions_determine_what_the_images_do_not(tmp_path: Path) -> None:
    truth = block()
    names = [photo.name for photo in match_graph(truth, sigma_px=0.3, reach=2).photos]
    alone = run_of(truth)
    assert alone.model is not None
    assert alone.model.intrinsics[0, 0] == 450
    assert len(warnings_of_focals(alone)) == 1
    run = run_of(truth, gps=table_of(tmp_path / "rtk.csv", truth, names, 0.02))
    assert run.model is not None
    assert not warnings_of_focals(run)
    assert run.model.intrinsics[0, 0] == pytest.approx(500, rel=0.02)
    assert run.gps is not None
    assert run.gps.intrinsics_sigmas is not None
    assert 0 < run.gps.intrinsics_sigmas[0, 0] < 10


@pytest.mark.parametrize("error", [InvalidArgument("positions: none"), KeyboardInterrupt()])
def test_positions_that_come_to_no_end_leave_it_held(error: BaseException) -> None:
    truth = strip()
    world = run_of(truth).model
    assert world is not None
    photos = match_graph(truth, sigma_px=0.3, reach=2).photos
    told = parse_camera_argument(450.0).cameras(photos, sharing="auto", model="auto")

    def adjust() -> None:
        assert not world.fixed_intrinsics[0, 0]
        raise error

    assert world.fixed_intrinsics[0, 0]
    with pytest.raises(type(error)):
        settle_focals_by_positions(world, told, IncrementalSettings(), adjust)
    assert world.fixed_intrinsics[0, 0]


def test_a_deviation_is_judged_beside_the_focal_length_that_it_is_of() -> None:
    truth = block()
    run = run_of(truth)
    assert run.model is not None
    world, settings = run.model, IncrementalSettings()
    graph = match_graph(truth, sigma_px=0.3, reach=2)
    told = parse_camera_argument(TOLD * truth.intrinsics[0, 0]).cameras(
        graph.photos, sharing="auto", model="auto"
    )
    world.fixed_intrinsics[0, 0] = False

    def adjust_with_positions() -> np.ndarray:
        world.intrinsics[0, 0] *= 2
        return np.full(world.intrinsics.shape, 0.03 * world.intrinsics[0, 0])

    focal = world.intrinsics[0, 0]
    assert settle_focals_by_positions(world, told, settings, adjust_with_positions) == []
    assert world.intrinsics[0, 0] == 2 * focal


@pytest.mark.parametrize(("model", "held"), [("auto", "held at 450 px"), ("simple-radial", "estimated as")])
def test_positions_too_rough_for_it_do_not(tmp_path: Path, model: str, held: str) -> None:
    truth = block()
    names = [photo.name for photo in match_graph(truth, sigma_px=0.3, reach=2).photos]
    run = run_of(truth, gps=table_of(tmp_path / "gps.csv", truth, names, 5.0), camera_model=model)
    (warning,) = warnings_of_focals(run)
    assert warning.startswith("images and positions do not determine the focal length")
    assert held in warning
    assert run.model is not None
    assert f"{run.model.intrinsics[0, 0]:.0f} px" in warning  # the value of the result


def test_whatever_is_held_is_warned_of() -> None:
    """Also where σ is small at the end, as where the observations were refined since."""
    truth = sfmcpp.circle_scene(10, 400, pixel_sigma_px=0.0, seed=4)
    graph = match_graph(truth, sigma_px=0.3, reach=2)
    run = reconstruct(graph, camera=1000.0, subpixel=False, gps="none")
    assert run.model is not None
    cameras = parse_camera_argument(1000.0).cameras(graph.photos, sharing="auto", model="auto")
    assert not settle_focals_by_images(run.model, cameras, IncrementalSettings())
    run.model.intrinsics[0, 0], run.model.fixed_intrinsics[0, 0] = 900.0, True
    (warning,) = settle_focals_by_images(run.model, cameras, IncrementalSettings())
    assert "held at 900 px" in warning
    assert run.model.intrinsics[0, 0] == 900


def test_views_from_all_sides_determine_it() -> None:
    run = run_of(sfmcpp.circle_scene(10, 400, pixel_sigma_px=0.0, seed=4))
    assert run.num_registered == 10
    assert not warnings_of_focals(run)
    assert run.model is not None
    assert not run.model.fixed_intrinsics[0, 0]


@pytest.mark.parametrize(
    ("model", "told", "warned"), [("opencv", 0.9, True), ("opencv", 1.0, False), ("auto", 0.9, False)]
)
def test_a_named_model_that_moves_the_focal_length_far_says_so(model: str, told: float, warned: bool) -> None:
    truth = sfmcpp.circle_scene(10, 400, pixel_sigma_px=0.0, seed=4)
    graph = match_graph(truth, sigma_px=0.3, reach=2)
    f_px = told * truth.intrinsics[0, 0]
    run = reconstruct(graph, camera=f_px, camera_model=model, subpixel=False, gps="none")
    moved = [text for text in run.warnings if "px that are told: camera model OPENCV, as named" in text]
    assert len(moved) == warned
    assert all(f"+11% from the {f_px:.0f} px" in text for text in moved)


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


@pytest.mark.parametrize(("model", "warned"), [("auto", False), ("opencv", True)])
def test_pixels_that_are_far_from_square_are_warned_of(model: str, warned: bool) -> None:
    """Level cameras around a scene leave open how high it is, and with it the aspect ratio."""
    graph = match_graph(sfmcpp.circle_scene(10, 400, pixel_sigma_px=0.0, seed=4), sigma_px=0.3, reach=2)
    run = reconstruct(graph, camera_model=model, subpixel=False, gps="none")
    assert any("pixels of cameras are square" in text for text in run.warnings) == warned


@pytest.mark.parametrize(("focal_px", "warned"), [(64.0, True), (400.0, False), (1e5, True)])
def test_focal_lengths_that_no_lens_has_are_warned_of(focal_px: float, warned: bool) -> None:
    graph = match_graph(sfmcpp.circle_scene(4, 200, pixel_sigma_px=0.0, seed=4), sigma_px=0.3, reach=2)
    (world,) = reconstruct(graph, subpixel=False, gps="none").models
    world.intrinsics[:, 0] = focal_px
    cameras = parse_camera_argument("auto").cameras(graph.photos, sharing="auto", model="auto")
    told = camera_warnings([world], cameras)
    assert [f"estimated as {focal_px:.0f} px" in text for text in told] == [True] * warned
