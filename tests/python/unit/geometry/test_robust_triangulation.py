"""Triangulation of tracks with wrong observations, against the truth and against the same without them."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from random_scenes import INTRINSICS, Array, project, residuals_of, views_of
from sfmcpp import InvalidArgument, Problem
from sfmcpp.geometry import robust_triangulation

NOISE_PX, LIMIT_PX = 0.5, 4.0


def cameras_round(count: int, degrees: float) -> Array:
    """Cameras on an arc of radius 8 that look at the origin."""
    cameras = []
    for angle in np.radians(np.linspace(0, degrees, count)):
        centre = 8 * np.array([np.cos(angle), np.sin(angle), 0.05 * np.sin(7 * angle)])
        forward = -centre / np.linalg.norm(centre)
        right = np.cross(forward, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        cameras.append(np.column_stack([right, np.cross(forward, right), forward, centre]))
    return np.stack(cameras)


def tracks(
    views: int, count: int, outliers: float, seed: int = 0
) -> tuple[Problem, Array, NDArray[np.bool_]]:
    """Tracks of `views` cameras each with noise; the true points, and which observations are outliers."""
    rng = np.random.default_rng(seed)
    cameras = cameras_round(views + 4, min(170.0, 8.0 * views + 20))
    points = rng.uniform(-2, 2, (count, 3))
    camera_index = (rng.integers(0, 5, count)[:, None] + np.arange(views)).ravel()
    point_index = np.repeat(np.arange(count), views)
    images = np.stack([project(camera, INTRINSICS, points) for camera in cameras])
    pixels = images[camera_index, point_index] + NOISE_PX * rng.standard_normal((count * views, 2))
    wrong = rng.random(len(pixels)) < outliers
    pixels[wrong] = rng.uniform(0, [700, 600], (np.count_nonzero(wrong), 2))
    order = rng.permutation(len(pixels))
    index = np.zeros(len(cameras), dtype=np.int32)
    unknown = np.full((count, 3), np.nan)
    problem = Problem(
        "calibrated", cameras, INTRINSICS[None], unknown, camera_index[order], point_index[order],
        pixels[order], intrinsics_index=index,
    )  # fmt: skip
    return problem, points, wrong[order]


def least_squares_point(problem: Problem, point: int, start: Array) -> Array:
    views = views_of(problem, point)
    return np.asarray(least_squares(lambda x: residuals_of(views, x), start).x)


def without(problem: Problem, wrong: NDArray[np.bool_]) -> Problem:
    keep = ~wrong
    index = problem.camera_index[keep], problem.point_index[keep]
    return replace(problem, camera_index=index[0], point_index=index[1], pixels=problem.pixels[keep])


@pytest.mark.parametrize(
    ("views", "count", "outliers"),
    [(2, 300, 0.0), (3, 300, 0.15), (4, 300, 0.25), (9, 100, 0.4), (50, 40, 0.5)],
)
def test_outliers_are_left_out_and_points_are_as_good_as_without_them(
    views: int, count: int, outliers: float
) -> None:
    problem, truth, wrong = tracks(views, count, outliers)
    points, inliers = robust_triangulation(problem, max_error_px=LIMIT_PX)
    num_good = np.bincount(problem.point_index[~wrong], minlength=count)
    # Of two good rays and one wrong one, the wrong may cross a good one by chance.
    solvable = num_good >= min(3, views)
    assert np.isfinite(points[solvable]).all()
    of_solvable = solvable[problem.point_index]
    assert np.count_nonzero(~inliers & of_solvable & ~wrong) <= 0.001 * len(wrong)
    # Some of what was put anywhere in the image falls near its place.
    assert np.count_nonzero(inliers & of_solvable & wrong) <= 0.005 * len(wrong)
    clean = without(problem, ~inliers)
    for point in np.flatnonzero(solvable)[:10]:
        best = least_squares_point(clean, point, truth[point])
        assert np.linalg.norm(points[point] - best) < 1e-4
    # Along the rays of two neighbours, 7.2° apart at a distance of 8, the noise is at its largest.
    depth_sigma = np.sqrt(2) * NOISE_PX * 8 / INTRINSICS[0] / np.radians(7.2)
    assert np.median(np.linalg.norm(points - truth, axis=1)[solvable]) < depth_sigma


def test_rays_that_meet_behind_their_cameras_explain_nothing() -> None:
    """Two noisy rays meet before all cameras, two exact ones behind theirs."""
    cameras = cameras_round(4, 60.0)
    behind = 3 * cameras[2:, :, 3].mean(axis=0)
    pixels = np.concatenate(
        [project(camera, INTRINSICS, np.zeros((1, 3))) for camera in cameras[:2]]
        + [project(camera, INTRINSICS, behind[None]) for camera in cameras[2:]]
    )
    pixels[:2] += [[0.0, 1.0], [0.0, -1.0]]
    problem = Problem(
        "calibrated", cameras, INTRINSICS[None], np.full((1, 3), np.nan), np.arange(4), np.zeros(4, int),
        pixels, intrinsics_index=np.zeros(4, int),
    )  # fmt: skip
    points, inliers = robust_triangulation(problem)
    assert np.linalg.norm(points) < 0.05
    assert inliers.tolist() == [True, True, False, False]


def test_points_without_agreement_or_angle_are_not_numbers() -> None:
    problem, _, _ = tracks(4, 60, 0.0, seed=1)
    rng = np.random.default_rng(2)
    scattered = problem.point_index < 20
    problem.pixels[scattered] = rng.uniform(0, [700, 600], (np.count_nonzero(scattered), 2))
    points, inliers = robust_triangulation(problem, max_error_px=1.5, min_views=3)
    known = np.isfinite(points).all(axis=1)
    # Three of four lines through random pixels nearly meet in few tracks.
    assert np.count_nonzero(known[:20]) <= 1
    assert known[20:].mean() > 0.95
    assert not inliers[~known[problem.point_index]].any()
    assert (np.bincount(problem.point_index[inliers], minlength=60)[known] >= 3).all()
    widest = 24 / 7 * 3 + 1
    assert np.isnan(robust_triangulation(problem, min_angle_deg=10 * widest)[0]).all()


def test_short_tracks_and_parallel_rays_are_left_open_beside_good_ones() -> None:
    problem, truth, _ = tracks(3, 30, 0.0)
    one_ray = (problem.point_index == 0) & (np.cumsum(problem.point_index == 0) > 1)
    unseen = problem.point_index == 1
    same_place = problem.point_index == 2
    problem.camera_index[same_place] = 0
    points, inliers = robust_triangulation(without(problem, one_ray | unseen))
    assert np.isnan(points[:3]).all()
    assert np.linalg.norm(points[3:] - truth[3:], axis=1).max() < 0.5
    assert len(inliers) == np.count_nonzero(~(one_ray | unseen))


def test_images_of_one_place_warn_of_nothing() -> None:
    """Rays so nearly parallel that they meet at infinity, as rounding has it: of an image given twice."""
    rng = np.random.default_rng(0)
    cameras = cameras_round(4, 40.0)
    turn = Rotation.from_rotvec([3e-9, -2e-9, 1e-9]).as_matrix()
    cameras[1] = np.column_stack([cameras[0, :, :3] @ turn, cameras[0, :, 3] + [3e-8, 1e-8, -2e-8]])
    truth = rng.uniform(-2, 2, (200, 3))
    camera_index, point_index = (index.ravel() for index in np.indices((4, 200)))
    pixels = np.concatenate([project(camera, INTRINSICS, truth) for camera in cameras])
    problem = Problem(
        "calibrated", cameras, INTRINSICS[None], np.full((200, 3), np.nan), camera_index, point_index,
        pixels, intrinsics_index=np.zeros(4, int),
    )  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        points, _ = robust_triangulation(problem)
    np.testing.assert_allclose(points, truth, atol=1e-5)


def test_tracks_do_not_depend_on_their_neighbours() -> None:
    problem, _, _ = tracks(5, 40, 0.3)
    points, inliers = robust_triangulation(problem)
    half = problem.point_index % 2 == 0
    some, agreeing = robust_triangulation(without(problem, ~half))
    np.testing.assert_array_equal(some[::2], points[::2])
    np.testing.assert_array_equal(agreeing, inliers[half])


def test_limits_are_checked() -> None:
    problem, _, _ = tracks(3, 5, 0.0)
    with pytest.raises(InvalidArgument, match="max_error_px = 0"):
        robust_triangulation(problem, max_error_px=0)
    with pytest.raises(InvalidArgument, match="min_views = 1"):
        robust_triangulation(problem, min_views=1)
