"""The circular scene against a projection written another way, and its noise against its own level."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from sfmcpp import InvalidArgument, Problem
from sfmcpp.sources.synthetic import circle_scene

MODELS = ("calibrated", "perspective", "bal")


def calibration_matrix(problem: Problem, camera: int) -> NDArray[np.float64]:
    value = dict(zip(problem.intrinsic_names, problem.intrinsics[camera], strict=True))
    fx, fy = value["f"], value["f"] * value.get("aspect", 1.0)
    return np.array([[fx, 0, value.get("cx", 0.0)], [0, fy, value.get("cy", 0.0)], [0, 0, 1]])


def homogeneous_images(problem: Problem) -> NDArray[np.float64]:
    """K [Rᵀ | −Rᵀ c] applied to every point in every camera: (C, N, 3), the depth last."""
    images = []
    for camera, pose in enumerate(problem.cameras):
        camera_from_world = np.linalg.inv(np.vstack([pose, [0, 0, 0, 1]]))[:3]
        matrix = calibration_matrix(problem, camera) @ camera_from_world
        images.append(np.column_stack([problem.points, np.ones(problem.num_points)]) @ matrix.T)
    return np.array(images)


def residuals(problem: Problem) -> NDArray[np.float64]:
    image = homogeneous_images(problem)[problem.camera_index, problem.point_index]
    return image[:, :2] / image[:, 2:] - problem.pixels


@pytest.mark.parametrize("camera_model", MODELS)
def test_exact_pixels_have_no_residual(camera_model: str) -> None:
    problem = circle_scene(7, 200, pixel_sigma_px=0.0, camera_model=camera_model, seed=1)
    assert np.abs(residuals(problem)).max() < 1e-9


@pytest.mark.parametrize("camera_model", MODELS)
def test_exactly_the_points_in_front_and_inside_the_image_are_observed(camera_model: str) -> None:
    # A small circle: the cube surrounds the cameras, so points lie behind them and outside their images.
    problem = circle_scene(5, 300, radius_m=2.0, pixel_sigma_px=0.0, camera_model=camera_model, seed=2)
    image = homogeneous_images(problem)
    corner = np.array([-320, -240]) if camera_model == "bal" else np.zeros(2)
    pixels = image[..., :2] / image[..., 2:] - corner
    expected = (image[..., 2] > 0) & (pixels >= 0).all(-1) & (pixels <= [640, 480]).all(-1)
    observed = np.zeros_like(expected)
    observed[problem.camera_index, problem.point_index] = True
    assert 0 < expected.sum() < expected.size / 2
    np.testing.assert_array_equal(observed, expected)
    assert problem.num_observations == expected.sum()


@pytest.mark.parametrize("sigma_px", [0.25, 1.0, 3.0])
def test_pixel_noise_has_the_asked_level_in_both_coordinates(sigma_px: float) -> None:
    noise = residuals(circle_scene(pixel_sigma_px=sigma_px, seed=3))
    assert len(noise) > 14_000
    # The standard error of a standard deviation from 14,000 values is 0.6 %, that of the mean 0.85 % of σ.
    np.testing.assert_allclose(noise.std(axis=0), sigma_px, rtol=0.025)
    np.testing.assert_allclose(noise.mean(axis=0), 0.0, atol=0.035 * sigma_px)
    assert abs(np.mean(noise[:, 0] * noise[:, 1])) < 0.035 * sigma_px**2


def test_pixel_noise_leaves_the_scene_and_the_choice_of_observations_alone() -> None:
    exact, noisy = (circle_scene(pixel_sigma_px=sigma, seed=4) for sigma in (0.0, 2.0))
    np.testing.assert_array_equal(exact.points, noisy.points)
    np.testing.assert_array_equal(exact.camera_index, noisy.camera_index)
    np.testing.assert_array_equal(exact.point_index, noisy.point_index)


def test_cameras_stand_on_the_circle_and_look_at_its_centre() -> None:
    problem = circle_scene(12, 10, radius_m=8.0)
    np.testing.assert_allclose(np.linalg.norm(problem.centres, axis=1), 8.0)
    spacing = np.linalg.norm(problem.centres - np.roll(problem.centres, 1, axis=0), axis=1)
    np.testing.assert_allclose(spacing, 2 * 8.0 * np.sin(np.pi / 12))
    np.testing.assert_allclose(problem.rotations[:, :, 2], -problem.centres / 8.0, atol=1e-15)


def test_rotations_are_proper_and_world_up_is_up_in_the_image() -> None:
    problem = circle_scene(9, 10)
    identity = np.broadcast_to(np.eye(3), (9, 3, 3))
    np.testing.assert_allclose(problem.rotations @ problem.rotations.transpose(0, 2, 1), identity, atol=1e-15)
    np.testing.assert_allclose(np.linalg.det(problem.rotations), 1.0)
    np.testing.assert_allclose(problem.rotations[:, 2, 1], -1.0)


def test_points_fill_the_cube_uniformly() -> None:
    points = circle_scene(2, 4000, cube_m=6.0, seed=5).points
    assert np.abs(points).max() <= 3.0
    np.testing.assert_allclose(points.std(axis=0), 6.0 / np.sqrt(12), rtol=0.05)
    np.testing.assert_allclose(points.mean(axis=0), 0.0, atol=0.1)


def test_the_thesis_scene_is_seen_whole_by_every_camera() -> None:
    problem = circle_scene()
    assert problem.num_observations == 30 * 500


def test_the_seed_decides_everything() -> None:
    first, again, other = (circle_scene(4, 50, seed=seed) for seed in (6, 6, 7))
    np.testing.assert_array_equal(first.points, again.points)
    np.testing.assert_array_equal(first.pixels, again.pixels)
    assert not np.array_equal(first.points, other.points)


def test_observations_are_sorted_by_point_then_camera() -> None:
    problem = circle_scene(5, 300, radius_m=2.0)
    key = problem.point_index.astype(np.int64) * problem.num_cameras + problem.camera_index
    assert (np.diff(key) > 0).all()


@pytest.mark.parametrize(
    ("options", "argument"),
    [
        ({"num_cameras": 0}, "num_cameras = 0"),
        ({"num_points": -3}, "num_points = -3"),
        ({"radius_m": 0.0}, "radius_m = 0.0"),
        ({"cube_m": float("nan")}, "cube_m = nan"),
        ({"focal_px": -1.0}, "focal_px = -1.0"),
        ({"image_size": (640, 0)}, r"image_size = \(640, 0\)"),
        ({"pixel_sigma_px": -0.5}, "pixel_sigma_px = -0.5"),
        ({"camera_model": "fisheye"}, "camera_model = 'fisheye'"),
    ],
)
def test_a_bad_argument_is_named_with_its_value(options: dict[str, Any], argument: str) -> None:
    with pytest.raises(InvalidArgument, match=argument):
        circle_scene(**options)
