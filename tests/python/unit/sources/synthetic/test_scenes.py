"""What holds for every scene: its noise, its seeds, its order, its cameras' models."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import sfmcpp
from sfmcpp import SCENES, InvalidArgument, Problem

SMALL: dict[str, dict[str, Any]] = {
    "circle": {"num_cameras": 12, "num_points": 300},
    "sphere": {"num_cameras": 12, "num_points": 300},
    "corridor": {"num_cameras": 40, "num_points": 2000, "length_m": 40.0},
    "street-loop": {"num_cameras": 80, "num_points": 3000},
    "city-blocks": {"num_cameras": 120},
    "drive-with-loops": {"num_cameras": 120},
    "photo-collection": {"num_cameras": 120, "cameras_per_landmark": 40},
    "rig-walk": {"num_cameras": 30, "num_points": 1000},
}
# These keep every point, seen or not.
COMPLETE = {"circle", "sphere"}


def scene(name: str, **options: Any) -> Problem:
    return SCENES[name](**{**SMALL[name], **options})


def views_of_points(problem: Problem) -> NDArray[np.intp]:
    return np.bincount(problem.point_index, minlength=problem.num_points)


def test_every_scene_is_tested_here() -> None:
    assert SMALL.keys() == SCENES.keys()


@pytest.mark.parametrize("name", SCENES)
def test_residuals_at_the_truth_are_the_noise(name: str) -> None:
    residuals = np.asarray(sfmcpp.residuals(scene(name, pixel_sigma_px=0.7, seed=1)))
    # The standard error of an RMS of n values is σ / sqrt(2 n); two-sided at four of them.
    np.testing.assert_allclose(np.sqrt(np.mean(residuals**2)), 0.7, rtol=4 / np.sqrt(2 * residuals.size))


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize(
    ("camera_model", "distortion"),
    [
        ("calibrated", (0.0, 0.0)),
        ("perspective", (0.0, 0.0)),
        ("perspective", (-0.08, 0.02)),
        ("bal", (0.0, 0.0)),
        ("bal", (0.1, -0.01)),
    ],
)
def test_exact_pixels_are_what_the_core_projects(
    name: str, camera_model: str, distortion: tuple[float, float]
) -> None:
    problem = scene(name, pixel_sigma_px=0.0, camera_model=camera_model, distortion=distortion)
    assert problem.num_observations > 1000
    assert np.abs(sfmcpp.residuals(problem)).max() < 1e-9


@pytest.mark.parametrize("name", SCENES)
def test_distortion_moves_the_pixels_by_its_polynomial(name: str) -> None:
    plain, distorted = (
        scene(name, pixel_sigma_px=0.0, camera_model="bal", distortion=d) for d in ((0, 0), (0.05, 0.02))
    )
    focal_px = plain.intrinsics[plain.intrinsics_index[distorted.camera_index], :1]
    # Pincushion distortion only drives observations out, so those left are all among the plain ones.
    pixel_at = {
        (c, tuple(plain.points[p])): pixel
        for c, p, pixel in zip(plain.camera_index, plain.point_index, plain.pixels, strict=True)
    }
    keys = zip(distorted.camera_index, distorted.points[distorted.point_index], strict=True)
    offsets = np.array([pixel_at[c, tuple(point)] for c, point in keys]) / focal_px
    squared_radius = (offsets**2).sum(axis=1, keepdims=True)
    expected = focal_px * offsets * (1 + 0.05 * squared_radius + 0.02 * squared_radius**2)
    np.testing.assert_allclose(distorted.pixels, expected, atol=1e-9)
    assert np.abs(distorted.pixels / focal_px - offsets).max() > 1e-4


@pytest.mark.parametrize("seed", [None, -1, 1.5, "a"])
@pytest.mark.parametrize("name", SCENES)
def test_what_seeds_nothing_is_refused(name: str, seed: object) -> None:
    with pytest.raises(InvalidArgument, match=r"seed = .*: must be an integer"):
        SCENES[name](seed=seed)


@pytest.mark.parametrize("name", SCENES)
def test_the_seed_decides_everything(name: str) -> None:
    first, again, other = (scene(name, seed=seed) for seed in (6, 6, 7))
    for array in ("cameras", "points", "pixels", "camera_index", "point_index"):
        np.testing.assert_array_equal(getattr(first, array), getattr(again, array))
    assert not np.array_equal(first.points, other.points)


@pytest.mark.parametrize("name", SCENES)
def test_pixel_noise_leaves_the_scene_and_the_choice_of_observations_alone(name: str) -> None:
    exact, noisy = (scene(name, pixel_sigma_px=sigma, seed=4) for sigma in (0.0, 2.0))
    np.testing.assert_array_equal(exact.points, noisy.points)
    np.testing.assert_array_equal(exact.camera_index, noisy.camera_index)
    np.testing.assert_array_equal(exact.point_index, noisy.point_index)


@pytest.mark.parametrize("name", SCENES)
def test_observations_are_sorted_by_point_then_camera_and_none_is_twice(name: str) -> None:
    problem = scene(name)
    key = problem.point_index.astype(np.int64) * problem.num_cameras + problem.camera_index
    assert (np.diff(key) > 0).all()


@pytest.mark.parametrize("name", SCENES)
def test_every_camera_sees_points_and_all_is_one_part(name: str) -> None:
    problem = scene(name)
    assert problem.num_cameras == SMALL[name]["num_cameras"]
    assert np.bincount(problem.camera_index, minlength=problem.num_cameras).min() >= 30
    assert sfmcpp.check(problem) == []


@pytest.mark.parametrize("name", SCENES)
def test_points_that_are_hardly_seen_are_dropped_by_the_large_scenes_alone(name: str) -> None:
    # A narrow view, so that some points are seen once or never.
    options = {"focal_px": 4000.0} if name in COMPLETE else {}
    views = views_of_points(scene(name, **options))
    if name in COMPLETE:
        assert len(views) == SMALL[name]["num_points"]
        assert views.min() < 2
    else:
        assert views.min() == 2


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("corridor", {"num_cameras": 4}),
        ("street-loop", {"num_cameras": 4}),
        ("city-blocks", {"spacing_m": 50.0, "num_points": 1, "num_cameras": 4}),
    ],
)
def test_a_scene_of_which_nothing_is_left_is_refused(name: str, options: dict[str, Any]) -> None:
    with pytest.raises(InvalidArgument, match="num_cameras = 4: no point is seen by two of them"):
        scene(name, **options)


@pytest.mark.parametrize("name", SCENES)
def test_rotations_are_proper_and_no_camera_leans(name: str) -> None:
    problem = scene(name)
    products = problem.rotations @ problem.rotations.transpose(0, 2, 1)
    np.testing.assert_allclose(products, np.broadcast_to(np.eye(3), products.shape), atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(problem.rotations), 1.0)
    np.testing.assert_allclose(problem.rotations[:, 2, 0], 0.0, atol=1e-14)
    assert (problem.rotations[:, 2, 1] < 0).all()


@pytest.mark.parametrize("name", SCENES)
def test_pixels_lie_in_the_image_whose_size_is_told(name: str) -> None:
    problem = scene(name, pixel_sigma_px=0.0, camera_model="perspective", image_size=(800, 500))
    np.testing.assert_array_equal(problem.metadata.image_sizes, [[800, 500]] * problem.num_cameras)
    assert problem.pixels.min() >= 0
    assert (problem.pixels.max(axis=0) <= [800, 500]).all()


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"num_cameras": 0}, "num_cameras = 0"),
        ({"num_points": 0}, "num_points = 0"),
        ({"focal_px": -1.0}, "focal_px = -1.0"),
        ({"image_size": (640, 0)}, r"image_size = \(640, 0\)"),
        ({"pixel_sigma_px": -0.5}, "pixel_sigma_px = -0.5"),
        ({"camera_model": "fisheye"}, "camera_model = 'fisheye'"),
        ({"camera_model": "calibrated", "distortion": (0.1, 0.0)}, r"distortion = \(0.1, 0.0\)"),
        ({"camera_model": "bal", "distortion": (0.1,)}, r"distortion = \(0.1,\)"),
        ({"camera_model": "bal", "distortion": (0.1, float("nan"))}, "distortion: k2 = nan"),
    ],
)
def test_a_bad_argument_is_named_with_its_value(name: str, options: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidArgument, match=message):
        scene(name, **options)


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("sphere", {"radius_m": 0.0}, "radius_m = 0.0"),
        ("sphere", {"ball_m": float("inf")}, "ball_m = inf"),
        ("corridor", {"num_cameras": 1}, "num_cameras = 1: must be at least 2"),
        ("corridor", {"length_m": -1.0}, "length_m = -1.0"),
        ("corridor", {"width_m": 0.0}, "width_m = 0.0"),
        ("corridor", {"height_m": float("nan")}, "height_m = nan"),
        ("corridor", {"max_depth_m": 0.0}, "max_depth_m = 0.0"),
        ("street-loop", {"length_m": 14.0}, "length_m = 14.0: must be finite and above 14"),
        ("street-loop", {"width_m": float("inf")}, "width_m = inf"),
        ("street-loop", {"street_m": 0.0}, "street_m = 0.0"),
        ("street-loop", {"max_depth_m": -2.0}, "max_depth_m = -2.0"),
        ("street-loop", {"yaw_deg": float("nan")}, "yaw_deg = nan"),
        ("city-blocks", {"num_cameras": 1}, "num_cameras = 1: must be at least 2"),
        ("city-blocks", {"spacing_m": 0.0}, "spacing_m = 0.0"),
        ("city-blocks", {"block_m": 10.0}, "block_m = 10.0: must be finite and above 14"),
        ("city-blocks", {"street_m": -1.0}, "street_m = -1.0"),
        ("city-blocks", {"max_depth_m": 11.0}, "max_depth_m = 11.0: must be finite and above 11.3"),
        ("drive-with-loops", {"num_cameras": 1}, "num_cameras = 1: must be at least 2"),
        ("drive-with-loops", {"block_m": 10.0}, "block_m = 10.0: must be finite and above 14"),
        ("photo-collection", {"num_cameras": 1}, "num_cameras = 1: must be at least 2"),
        ("photo-collection", {"cameras_per_landmark": 1}, "cameras_per_landmark = 1: must be at least 2"),
        ("photo-collection", {"focal_spread": -0.1}, "focal_spread = -0.1"),
    ],
)
def test_a_bad_measure_is_named_with_its_value(name: str, options: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidArgument, match=message):
        scene(name, **options)
