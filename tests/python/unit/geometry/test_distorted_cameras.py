"""Cameras with distortion: the same geometry, with errors measured in the pixels that were seen."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares, minimize

from random_scenes import angle_deg, random_camera
from sfmcpp import Problem
from sfmcpp.geometry import (
    mean_reprojection_errors_px,
    pose_inliers,
    refine_points,
    relative_pose,
    reprojection_errors_px,
    resection,
    triangulate_linear,
    triangulate_midpoint,
)
from sfmcpp.geometry._matches import checked_matches
from sfmcpp.geometry.epipolar import fundamental_matrix
from sfmcpp.geometry.pinhole import image_slopes, intrinsics_row, to_normalised, to_pixels
from sfmcpp.geometry.pose_estimate import PoseEstimate

PERSPECTIVE = np.array([700, 1.1, 310, 250, 4, -0.25, 0.08, 0.01, -0.003, 0.001, 0.004, -0.006])
BAL = np.array([650.0, -0.2, 0.05])
ROWS = {"perspective": PERSPECTIVE, "bal": BAL}


def seen_at(points: np.ndarray, model: str) -> np.ndarray:
    """Pixels (N, 2) of points (N, 3) in the camera, from the definition of the camera model."""
    row = PERSPECTIVE if model == "perspective" else np.r_[BAL[0], 1, 0, 0, 0, BAL[1:], np.zeros(5)]
    f, aspect, cx, cy, skew, *k, p1, p2 = row
    x, y = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
    r2 = x**2 + y**2
    radial = 1 + sum(k[i] * r2 ** (i + 1) for i in range(5))
    xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2)
    yd = y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y
    return np.column_stack([f * xd + skew * yd + cx, aspect * f * yd + cy])


def in_camera(camera: np.ndarray, points: np.ndarray) -> np.ndarray:
    return (points - camera[:, 3]) @ camera[:, :3]


def scene(model: str, seed: int, sigma_px: float = 0.0, points: int = 40, cameras: int = 5) -> Problem:
    """Every camera sees every point."""
    rng = np.random.default_rng(seed)
    poses = np.stack([random_camera(rng, rng.uniform(0.5, 1.5)) for _ in range(cameras)])
    cloud = rng.uniform([-3, -2.5, 5], [3, 2.5, 10], (points, 3))
    pixels = np.concatenate([seen_at(in_camera(pose, cloud), model) for pose in poses])
    pixels += rng.normal(0, sigma_px, pixels.shape)
    camera, point = (index.ravel() for index in np.indices((cameras, points)))
    return Problem(
        model, poses, ROWS[model][None], cloud, camera, point, pixels, intrinsics_index=np.zeros(cameras, int)
    )


@pytest.mark.parametrize("model", ROWS)
def test_pixels_are_those_of_the_camera_model_and_go_back(model: str) -> None:
    points = np.random.default_rng(0).uniform(-0.45, 0.45, (200, 2))
    row = intrinsics_row("row", ROWS[model])
    pixels = to_pixels(points, row)
    np.testing.assert_allclose(pixels, seen_at(np.c_[points, np.ones(200)], model), atol=1e-9)
    np.testing.assert_allclose(to_normalised(pixels, row), points, atol=1e-12)
    np.testing.assert_allclose(to_normalised(pixels, np.tile(row, (200, 1))), points, atol=1e-12)


@pytest.mark.parametrize("model", ROWS)
def test_slopes_of_the_image_are_its_differences(model: str) -> None:
    points = np.random.default_rng(1).uniform(-0.5, 0.5, (50, 2))
    row, step = intrinsics_row("row", ROWS[model]), 1e-6
    for axis in range(2):
        shift = step * np.eye(2)[axis]
        numeric = (to_pixels(points + shift, row) - to_pixels(points - shift, row)) / (2 * step)
        np.testing.assert_allclose(image_slopes(points, row)[:, :, axis], numeric, rtol=1e-6, atol=1e-5)


@pytest.mark.parametrize("triangulate", [triangulate_linear, triangulate_midpoint])
@pytest.mark.parametrize("model", ROWS)
def test_points_are_found_through_distorting_lenses(model: str, triangulate: object) -> None:
    problem = scene(model, seed=2)
    np.testing.assert_allclose(triangulate(problem), problem.points, atol=1e-7)  # type: ignore[operator]


@pytest.mark.parametrize("model", ROWS)
def test_errors_are_measured_in_the_pixels_seen(model: str) -> None:
    problem = scene(model, seed=3)
    offsets = np.random.default_rng(3).normal(0, 5, problem.pixels.shape)
    problem.pixels += offsets
    lengths = np.linalg.norm(offsets, axis=1)
    np.testing.assert_allclose(reprojection_errors_px(problem, problem.points), lengths, atol=1e-9)
    problem.cameras[0, :, :3] = problem.cameras[0, :, :3] @ np.diag([-1.0, 1, -1])
    behind = problem.camera_index == 0
    assert np.isinf(reprojection_errors_px(problem, problem.points)[behind]).all()
    expected = lengths[~behind].reshape(4, -1).mean(axis=0)
    np.testing.assert_allclose(mean_reprojection_errors_px(problem, problem.points), expected, atol=1e-9)


@pytest.mark.parametrize("model", ROWS)
def test_refined_points_have_the_least_sum_of_squares(model: str) -> None:
    problem = scene(model, seed=4, sigma_px=1.0, points=10)
    found = refine_points(problem, triangulate_linear(problem), max_steps=50)
    for point in range(problem.num_points):
        mine = problem.point_index == point
        poses, pixels = problem.cameras[problem.camera_index[mine]], problem.pixels[mine]

        def errors(x: np.ndarray, poses: np.ndarray = poses, pixels: np.ndarray = pixels) -> np.ndarray:
            seen = [seen_at(in_camera(pose, x[None]), model)[0] for pose in poses]
            return np.ravel(np.array(seen) - pixels)

        best = least_squares(errors, problem.points[point], xtol=1e-15, ftol=1e-15, gtol=1e-15).x
        np.testing.assert_allclose(found[point], best, atol=1e-5)


def located(problem: Problem, row: np.ndarray) -> PoseEstimate:
    return resection(problem.points, problem.pixels[problem.camera_index == 1], row)


@pytest.mark.parametrize("model", ROWS)
def test_a_distorted_image_is_located_and_not_without_its_distortion(model: str) -> None:
    pytest.importorskip("poselib")
    problem = scene(model, seed=5, points=100)
    found = located(problem, ROWS[model])
    np.testing.assert_allclose(found.camera, problem.cameras[1], atol=1e-7)
    assert found.inliers.all()
    without = intrinsics_row("row", ROWS[model])[:5]
    blind = located(problem, without)
    assert not blind.success or np.linalg.norm(blind.camera[:, 3] - problem.cameras[1, :, 3]) > 1e-3


def test_inliers_of_a_pose_are_told_by_the_pixels_seen() -> None:
    pytest.importorskip("poselib")
    problem = scene("bal", seed=6, points=100)
    pixels = problem.pixels[problem.camera_index == 1].copy()
    # Near the edge of the image the lens shrinks: 2.9 px seen are more than 3 px without distortion.
    edge = np.argsort(np.linalg.norm(pixels, axis=1))[-4:]
    outward = pixels[edge] / np.linalg.norm(pixels[edge], axis=1, keepdims=True)
    pixels[edge] += outward * np.array([[2.9], [3.1], [2.9], [3.1]])
    found = resection(problem.points, pixels, BAL, threshold_px=3.0, max_iterations=2000)
    np.testing.assert_allclose(found.camera, problem.cameras[1], atol=0.02)
    row = intrinsics_row("row", BAL)
    told = pose_inliers(problem.cameras[1], problem.points, pixels, row, 3.0)
    assert told[edge].tolist() == [True, False, True, False]
    moved = to_normalised(pixels[edge], row) - to_normalised(
        problem.pixels[problem.camera_index == 1][edge], row
    )
    assert (BAL[0] * np.linalg.norm(moved, axis=1) > 3.0).all()


@pytest.mark.parametrize("model", ROWS)
def test_two_distorted_images_tell_their_relative_pose(model: str) -> None:
    pytest.importorskip("poselib")
    problem = scene(model, seed=7, points=200)
    first, second = (problem.pixels[problem.camera_index == k] for k in (0, 1))
    found = relative_pose(first, second, ROWS[model])
    a, b = problem.cameras[:2]
    rotation, baseline = a[:, :3].T @ b[:, :3], a[:, :3].T @ (b[:, 3] - a[:, 3])
    assert found.success
    assert angle_deg(found.camera[:, :3], rotation) < 1e-4
    assert angle_deg(found.camera[:, 3], baseline) < 1e-3
    assert found.inliers.all()


def test_errors_of_matches_are_distances_in_the_pixels_seen() -> None:
    rng = np.random.default_rng(8)
    camera = random_camera(rng)
    points = rng.uniform([-3, -2.5, 5], [3, 2.5, 9], (12, 3))
    offsets = rng.normal(0, 0.5, (2, 12, 2))
    pixels_1 = seen_at(points, "perspective") + offsets[0]
    pixels_2 = seen_at(in_camera(camera, points), "perspective") + offsets[1]
    errors = checked_matches(pixels_1, pixels_2, PERSPECTIVE, None).errors_px(camera)
    row = PERSPECTIVE[:5]
    f = fundamental_matrix(np.eye(3, 4), camera, row, row)

    def epipolar(both: np.ndarray) -> float:
        u, v = (np.r_[to_pixels(to_normalised(p, PERSPECTIVE), row), 1.0] for p in both.reshape(2, 2))
        return float(1e3 * u @ f @ v)

    for k in range(12):
        start = np.r_[pixels_1[k], pixels_2[k]]
        nearest = minimize(
            lambda x, start=start: ((x - start) ** 2).sum(),
            start,
            constraints={"type": "eq", "fun": epipolar},
            options={"ftol": 1e-12},
        )
        np.testing.assert_allclose(errors[k], np.sqrt(nearest.fun), rtol=0.02, atol=1e-3)
