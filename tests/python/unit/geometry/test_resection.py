"""Resection against known truth, an independent optimiser, and its own named failures."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from random_scenes import INTRINSICS, Array, angle_deg, project, random_camera, random_pair, spoil
from sfmcpp import InvalidArgument, circle_scene
from sfmcpp.geometry import resection


def noisy_view(seed: int, sigma_px: float, outliers: float, count: int = 300) -> tuple[Any, ...]:
    rng = np.random.default_rng(seed)
    pair = random_pair(seed, count)
    pixels = pair.pixels_2 + sigma_px * rng.standard_normal(pair.pixels_2.shape)
    return pair, pixels, spoil(pixels, outliers, rng)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(300, 3000), st.floats(0.8, 1.25), st.floats(-20, 20))
def test_exact_matches_give_the_true_pose(seed: int, f: float, aspect: float, skew: float) -> None:
    rng = np.random.default_rng(seed)
    row = np.array([f, aspect, 320.0, 240.0, skew])
    camera = random_camera(rng, 3.0, 3.0)
    in_camera = rng.uniform([-4, -3, 4], [4, 3, 12], (40, 3))
    points = in_camera @ camera[:, :3].T + camera[:, 3]
    found = resection(points, project(camera, row, points), row, seed=seed)
    assert found.success
    assert found.inliers.all()
    np.testing.assert_allclose(found.camera, camera, atol=1e-6)


@pytest.mark.parametrize("fraction", [0.1, 0.3, 0.5])
@pytest.mark.parametrize("seed", range(4))
def test_outliers_are_told_apart_and_leave_the_pose_alone(seed: int, fraction: float) -> None:
    pair, pixels, spoilt = noisy_view(seed, 0.5, fraction)
    found = resection(pair.points, pixels, INTRINSICS, seed=seed)
    far = np.linalg.norm(pixels - pair.pixels_2, axis=1) > 5.0
    assert found.inliers[~spoilt].all()
    assert not found.inliers[far].any()
    assert angle_deg(found.camera[:, :3], pair.camera[:, :3]) < 0.1
    assert np.linalg.norm(found.camera[:, 3] - pair.camera[:, 3]) < 0.015


def test_every_camera_of_the_circular_scene_is_found() -> None:
    problem = circle_scene(6, 300, pixel_sigma_px=1.0, seed=4)
    for camera in range(6):
        seen = problem.camera_index == camera
        points = problem.points[problem.point_index[seen]]
        found = resection(points, problem.pixels[seen], problem.intrinsics[camera])
        assert np.linalg.norm(found.camera[:, 3] - problem.centres[camera]) < 0.08
        assert angle_deg(found.camera[:, :3], problem.rotations[camera]) < 0.2


def test_the_pose_minimises_the_robust_reprojection_error() -> None:
    pair, pixels, _ = noisy_view(5, 0.7, 0.0, 100)
    found = resection(pair.points, pixels, INTRINSICS, threshold_px=6.0)
    assert found.inliers.all()

    def residuals(x: Array) -> Array:
        turn = found.camera[:, :3] @ Rotation.from_rotvec(x[:3]).as_matrix()
        moved = np.column_stack([turn, found.camera[:, 3] + x[3:]])
        return (project(moved, INTRINSICS, pair.points) - pixels).ravel()

    best = least_squares(residuals, np.zeros(6), xtol=1e-14, ftol=1e-14)
    ours = 0.5 * np.sum(residuals(np.zeros(6)) ** 2)
    # The robust loss and the ideal camera's square pixels weigh a little differently.
    assert ours <= best.cost * (1 + 5e-3)
    assert ours < 0.5 * np.sum((pair.pixels_2 - pixels) ** 2)


@pytest.mark.parametrize("unit", [1e-8, 1.0, 1e7])
@pytest.mark.parametrize("east", [0.0, 5e6])
def test_the_pose_depends_neither_on_the_unit_of_length_nor_on_the_origin(unit: float, east: float) -> None:
    pair, pixels, _ = noisy_view(3, 0.5, 0.0, count=60)
    origin = unit * np.array([east, -east, 0.0])
    here = resection(pair.points, pixels, INTRINSICS)
    there = resection(unit * pair.points + origin, pixels, INTRINSICS)
    np.testing.assert_allclose((there.camera[:, 3] - origin) / unit, here.camera[:, 3], atol=1e-6)
    np.testing.assert_allclose(there.camera[:, :3], here.camera[:, :3], atol=1e-7)


@pytest.mark.parametrize("east", [1e3, 1e4, 1e6])
def test_a_world_that_is_moved_gives_the_same_pose_but_for_rounding(east: float) -> None:
    origin, atol = np.array([east, -east, 0.0]), 1e-14 * east
    for seed in range(5):
        pair, pixels, _ = noisy_view(seed, 0.5, 0.2, count=60)
        here = resection(pair.points, pixels, INTRINSICS)
        there = resection(pair.points + origin, pixels, INTRINSICS)
        np.testing.assert_allclose(there.camera[:, 3] - origin, here.camera[:, 3], rtol=0, atol=atol)
        np.testing.assert_allclose(there.camera[:, :3], here.camera[:, :3], rtol=0, atol=atol)


def test_inliers_are_those_in_front_and_within_the_threshold() -> None:
    pair, pixels, _ = noisy_view(6, 1.0, 0.2)
    behind = 2 * pair.camera[:, 3] - pair.points[:30]
    points = np.vstack([pair.points, behind])
    pixels = np.vstack([pixels, project(pair.camera, INTRINSICS, behind)])
    found = resection(points, pixels, INTRINSICS, threshold_px=1.0)
    errors = np.linalg.norm(project(found.camera, INTRINSICS, points) - pixels, axis=1)
    np.testing.assert_array_equal(found.inliers, (errors <= 1.0) & (np.arange(330) < 300))
    assert (errors[300:] <= 1.0).any()


def test_the_seed_decides_the_samples() -> None:
    pair, pixels, _ = noisy_view(7, 1.0, 0.4)
    hasty: dict[str, Any] = {"max_iterations": 1, "min_inliers": 4, "min_inlier_ratio": 1e-9}
    cameras = [resection(pair.points, pixels, INTRINSICS, seed=seed, **hasty).camera for seed in (0, 0, 9)]
    np.testing.assert_array_equal(cameras[0], cameras[1])
    assert not np.array_equal(cameras[0], cameras[2])


@pytest.mark.parametrize("count", [0, 3, 9])
def test_too_few_matches_are_named(count: int) -> None:
    pair = random_pair(8, 9)
    found = resection(pair.points[:count], pair.pixels_2[:count], INTRINSICS)
    assert (found.failure, found.message) == ("too few matches", f"{count} matches: must be at least 10")
    assert np.isnan(found.camera).all()


@pytest.mark.parametrize("count", [50, 400])
def test_matches_at_random_give_no_pose(count: int) -> None:
    rng = np.random.default_rng(count)
    found = resection(rng.uniform(-5, 5, (count, 3)), rng.uniform(0, 640, (count, 2)), INTRINSICS)
    assert found.failure == "too few inliers"
    assert np.isnan(found.camera).all()


def test_points_on_a_line_give_no_pose() -> None:
    points = np.array([-2.0, 1.0, 6.0]) + np.linspace(0, 5, 60)[:, None] * [0.8, -0.3, 0.5]
    found = resection(points, project(random_pair(9).camera, INTRINSICS, points), INTRINSICS)
    assert found.failure == "collinear points"
    assert found.message == "60 points on one line: the camera may turn round it"
    assert np.isnan(found.camera).all()


def test_points_on_a_plane_give_the_pose() -> None:
    pair = random_pair(10, 80)
    points = pair.points.copy()
    points[:, 2] = 8.0
    found = resection(points, project(pair.camera, INTRINSICS, points), INTRINSICS)
    np.testing.assert_allclose(found.camera, pair.camera, atol=1e-6)


GOOD = random_pair(11, 20)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"points": GOOD.points[:, :2]}, r"points: shape \(20, 2\), must be \(any, 3\)"),
        ({"points": GOOD.points * np.inf}, r"points\[0, 0\] = -?inf: must be finite"),
        ({"pixels": GOOD.pixels_2[1:]}, r"pixels: shape \(19, 2\), must be \(20, 2\)"),
        ({"intrinsics": np.zeros(5)}, r"intrinsics\[0\] = 0.0: f must be positive"),
        ({"threshold_px": -1.0}, "threshold_px = -1.0: must be finite and positive"),
        ({"min_inliers": 3}, "min_inliers = 3: must be at least 4"),
        ({"min_inlier_ratio": 0.0}, "min_inlier_ratio = 0.0: must lie between 0 and 1"),
        ({"confidence": 0.0}, "confidence = 0.0: must lie between 0 and 1"),
        ({"max_iterations": -5}, "max_iterations = -5: must be at least 1"),
        ({"seed": True}, "seed = True: must be an integer from 0"),
    ],
)
def test_a_bad_argument_is_named_with_its_value(change: dict[str, Any], message: str) -> None:
    good = {"points": GOOD.points, "pixels": GOOD.pixels_2, "intrinsics": INTRINSICS}
    with pytest.raises(InvalidArgument, match=message):
        resection(**{**good, **change})
