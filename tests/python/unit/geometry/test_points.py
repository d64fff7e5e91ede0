"""Refinement and tests of points against one-at-a-time references."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

import sfmcpp
from random_scenes import Array, ragged_problem, residuals_of, views_of
from sfmcpp import InvalidArgument, Problem, circle_scene
from sfmcpp.geometry import (
    _tracks,
    depths,
    refine_points,
    reliable_points,
    reprojection_errors_px,
    triangulate_linear,
    triangulate_midpoint,
    triangulation_angles_deg,
)


def costs(problem: Problem, points: Array) -> Array:
    """Sum of squared errors of each point, weighted by the standard deviations."""
    sigma = np.ones(problem.num_observations) if problem.sigma_px is None else problem.sigma_px
    return np.array(
        [
            np.sum(
                (residuals_of(views_of(problem, n), x) / np.repeat(sigma[problem.point_index == n], 2)) ** 2
            )
            for n, x in enumerate(points)
        ]
    )


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_refined_points_are_those_of_an_independent_optimiser(seed: int, weighted: bool) -> None:
    problem = ragged_problem(seed, 25, sigma_px=2.0)
    if weighted:
        problem.sigma_px = np.random.default_rng(seed).uniform(0.5, 4.0, problem.num_observations)
    refined = refine_points(problem, triangulate_midpoint(problem))
    sigma = np.ones(problem.num_observations) if problem.sigma_px is None else problem.sigma_px
    for n in range(problem.num_points):
        views, scale = views_of(problem, n), np.repeat(sigma[problem.point_index == n], 2)

        def weighted_residuals(x: Array, views: Any = views, scale: Array = scale) -> Array:
            return residuals_of(views, x) / scale

        best = least_squares(weighted_residuals, problem.points[n], xtol=1e-14, ftol=1e-14, gtol=1e-14)
        assert np.sum(weighted_residuals(refined[n]) ** 2) <= 2 * best.cost * (1 + 1e-8)
        np.testing.assert_allclose(refined[n], best.x, atol=1e-3, rtol=1e-3)


@pytest.mark.parametrize("seed", range(3))
def test_points_refined_with_covariances_are_those_of_an_independent_optimiser(seed: int) -> None:
    problem = ragged_problem(seed, 25, sigma_px=2.0)
    rng = np.random.default_rng(seed)
    factors = rng.normal(0, 1, (problem.num_observations, 2, 2)) + 2 * np.eye(2)
    problem.covariance_px2 = factors @ np.swapaxes(factors, 1, 2)
    refined = refine_points(problem, triangulate_midpoint(problem))
    for n in range(problem.num_points):
        views = views_of(problem, n)
        inverses = np.linalg.inv(problem.covariance_px2[problem.point_index == n])
        roots = np.swapaxes(np.linalg.cholesky(inverses), 1, 2)

        def whitened(x: Array, views: Any = views, roots: Array = roots) -> Array:
            return np.einsum("mij,mj->mi", roots, residuals_of(views, x).reshape(-1, 2)).ravel()

        best = least_squares(whitened, problem.points[n], xtol=1e-14, ftol=1e-14, gtol=1e-14)
        assert np.sum(whitened(refined[n]) ** 2) <= 2 * best.cost * (1 + 1e-8)
        np.testing.assert_allclose(refined[n], best.x, atol=1e-3, rtol=1e-3)


def test_points_refined_with_round_covariances_have_the_bits_of_standard_deviations() -> None:
    problem = ragged_problem(4, 25, sigma_px=2.0)
    problem.sigma_px = np.random.default_rng(4).uniform(0.5, 4.0, problem.num_observations)
    by_covariance = problem.copy()
    by_covariance.sigma_px = None
    by_covariance.covariance_px2 = problem.sigma_px[:, None, None] ** 2 * np.eye(2)
    start = triangulate_midpoint(problem)
    np.testing.assert_array_equal(refine_points(by_covariance, start), refine_points(problem, start))


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.1, 3.0))
@example(859, 1.0)  # one point runs away until its matrix has rank two
def test_no_point_gets_worse_from_a_far_start(seed: int, distance: float) -> None:
    problem = ragged_problem(seed, 30, sigma_px=1.0)
    rng = np.random.default_rng(seed)
    start = problem.points + distance * rng.standard_normal(problem.points.shape)
    refined = refine_points(problem, start)
    moved = (refined != start).any(axis=1)
    before, after = costs(problem, start), costs(problem, refined)
    assert (after[moved] < before[moved]).all()
    in_front = np.bincount(problem.point_index, depths(problem, start) <= 0, problem.num_points) == 0
    np.testing.assert_array_equal(moved, in_front)
    assert np.median(after) < 3 * np.median(costs(problem, problem.points))


@pytest.mark.parametrize("stretch", [0.3, 5.0, 50.0])
def test_badly_placed_points_never_get_worse_and_arrive(stretch: float) -> None:
    problem = ragged_problem(8, 100, sigma_px=1.0)
    start, best = stretch * problem.points, refine_points(problem, problem.points)
    before, after = costs(problem, start), costs(problem, refine_points(problem, start, max_steps=1))
    assert (after <= before).all()
    found = refine_points(problem, start, max_steps=60)
    assert (costs(problem, found) <= costs(problem, best) * (1 + 1e-6)).all()


def test_points_without_a_start_or_without_two_views_stay() -> None:
    problem = ragged_problem(1, 8, sigma_px=1.0)
    start = triangulate_linear(problem)
    once = np.flatnonzero(problem.point_index == 3)[1:]
    kept = np.setdiff1d(np.arange(problem.num_observations), once)
    fewer = Problem(
        "calibrated",
        problem.cameras,
        problem.intrinsics,
        problem.points,
        problem.camera_index[kept],
        problem.point_index[kept],
        problem.pixels[kept],
        intrinsics_index=problem.intrinsics_index,
    )
    start[5] = np.nan
    refined = refine_points(fewer, start)
    stay = np.isin(np.arange(8), [3, 5])
    np.testing.assert_array_equal(refined[stay], start[stay])
    np.testing.assert_array_equal((refined != start).all(axis=1)[~stay], True)


def test_more_steps_never_raise_the_cost() -> None:
    problem = ragged_problem(2, 40, sigma_px=2.0)
    start = problem.points * 1.3 + 0.1
    history = np.array([costs(problem, refine_points(problem, start, max_steps=n)) for n in (1, 2, 4, 8, 16)])
    assert (np.diff(history, axis=0) <= 1e-9 * history[:-1]).all()
    assert history[-1].sum() < 0.5 * history[0].sum()


def test_errors_and_depths_are_those_of_the_solver() -> None:
    problem = circle_scene(4, 50, pixel_sigma_px=2.0, seed=3)
    expected = np.linalg.norm(sfmcpp.residuals(problem), axis=1)
    np.testing.assert_allclose(reprojection_errors_px(problem, problem.points), expected, atol=1e-9)


def test_errors_and_depths_are_those_of_one_point_at_a_time() -> None:
    problem = ragged_problem(4, 20, sigma_px=1.0)
    points = problem.points * [1, 1, -1]
    points[:10] = problem.points[:10]
    points[13] = np.nan
    found, depth = reprojection_errors_px(problem, points), depths(problem, points)
    for m, (c, n) in enumerate(zip(problem.camera_index, problem.point_index, strict=True)):
        in_camera = np.linalg.inv(np.vstack([problem.cameras[c], [0, 0, 0, 1]])) @ np.append(points[n], 1.0)
        np.testing.assert_allclose(depth[m], in_camera[2], rtol=1e-9)
        views = [v for v in views_of(problem, n) if (v[1] == problem.pixels[m]).all()]
        expected = np.linalg.norm(residuals_of(views, points[n])) if in_camera[2] > 0 else np.inf
        np.testing.assert_allclose(found[m], expected, rtol=1e-9)
    assert 0 < np.isinf(found).sum() < len(found)


def test_angles_are_the_largest_between_any_two_cameras() -> None:
    problem = ragged_problem(5, 40, 9, min_views=1)
    points = problem.points.copy()
    points[7] = np.nan
    expected = np.zeros(40)
    for n in range(40):
        centres = problem.centres[problem.camera_index[problem.point_index == n]]
        rays = [(points[n] - c) / np.linalg.norm(points[n] - c) for c in centres]
        cosines = [a @ b for a in rays for b in rays if n != 7]
        expected[n] = np.degrees(np.arccos(np.clip(min(cosines, default=1.0), -1, 1)))
    assert len(set(np.bincount(problem.point_index))) > 4
    np.testing.assert_allclose(triangulation_angles_deg(problem, points), expected, atol=1e-5)


def test_a_tiny_angle_keeps_its_digits() -> None:
    aside = np.column_stack([np.eye(3), [1e-7, 0, 0]])
    rows = np.tile([500.0, 1, 320, 240, 0], (2, 1))
    problem = Problem(
        "calibrated",
        np.stack([np.eye(3, 4), aside]),
        rows,
        np.zeros((1, 3)),
        [0, 1],
        [0, 0],
        np.zeros((2, 2)),
    )
    found = triangulation_angles_deg(problem, np.array([[0.0, 0.0, 2.0]]))
    np.testing.assert_allclose(found, np.degrees(5e-8), rtol=1e-6)


@pytest.mark.parametrize("pairs_at_once", [1, 30, 4_000_000])
def test_pieces_do_not_change_the_angles(monkeypatch: pytest.MonkeyPatch, pairs_at_once: int) -> None:
    problem = ragged_problem(6, 40)
    expected = triangulation_angles_deg(problem, problem.points)
    monkeypatch.setattr("sfmcpp.geometry.point_tests._PAIRS_AT_ONCE", pairs_at_once)
    np.testing.assert_array_equal(triangulation_angles_deg(problem, problem.points), expected)
    assert (expected > 0).all()


def test_pieces_do_not_change_a_bit_of_points_in_cameras(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = ragged_problem(6, 40)
    points = problem.points.copy()
    points[3], points[4] = np.nan, np.inf
    offsets = points[problem.point_index] - problem.centres[problem.camera_index]
    expected = np.einsum("mij,mi->mj", problem.rotations[problem.camera_index], offsets)
    errors = reprojection_errors_px(problem, points)
    for size in (1, 7, len(expected)):
        monkeypatch.setattr(_tracks, "_OBSERVATIONS_AT_ONCE", size)
        np.testing.assert_array_equal(_tracks.points_in_cameras(problem, points), expected)
        np.testing.assert_array_equal(reprojection_errors_px(problem, points), errors)


def test_points_at_infinity_are_not_reliable_and_have_no_error_that_is_not_a_number() -> None:
    cameras = np.tile(np.column_stack([rotation_towards_ones(), np.zeros(3)]), (2, 1, 1))
    cameras[1, 0, 3] = 1.0
    intrinsics, pixels = np.array([[500.0, 1, 320, 240, 0]] * 2), np.array([[320.0, 240]] * 2)
    points = np.full((1, 3), np.inf)
    problem = Problem("calibrated", cameras, intrinsics, np.zeros((1, 3)), [0, 1], [0, 0], pixels)
    assert sfmcpp.geometry.reprojection_errors_px(problem, points).tolist() == [np.inf, np.inf]
    assert not reliable_points(problem, points, min_angle_deg=0.0)[0]


def rotation_towards_ones() -> Array:
    """Rotation whose third axis has positive coordinates only."""
    ahead = np.ones(3) / np.sqrt(3)
    right = np.array([1.0, -1, 0]) / np.sqrt(2)
    return np.column_stack([right, np.cross(ahead, right), ahead])


def test_reliable_points_pass_every_test() -> None:
    problem = ragged_problem(7, 200, sigma_px=1.0)
    points = problem.points.copy()
    points[:20] *= [1, 1, -1]
    points[20] = np.nan
    limits: dict[str, Any] = {"max_error_px": 2.5, "min_angle_deg": 8.0, "min_views": 3}
    errors, angles = reprojection_errors_px(problem, points), triangulation_angles_deg(problem, points)
    expected = np.array(
        [
            errors[problem.point_index == n].max() <= 2.5
            and angles[n] >= 8.0
            and np.count_nonzero(problem.point_index == n) >= 3
            for n in range(200)
        ]
    )
    found = reliable_points(problem, points, **limits)
    np.testing.assert_array_equal(found, expected)
    assert not found[:21].any()
    for name, loose in {"max_error_px": 1e9, "min_angle_deg": 0.0, "min_views": 1}.items():
        assert reliable_points(problem, points, **{**limits, name: loose}).sum() > found.sum()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda p: refine_points(p, p.points[:3]), r"points: shape \(3, 3\), must be \(5, 3\)"),
        (lambda p: refine_points(p, p.points, max_steps=0), "max_steps = 0: must be at least 1"),
        (lambda p: depths(p, p.points[:, :2]), r"points: shape \(5, 2\), must be \(5, 3\)"),
        (lambda p: reprojection_errors_px(p, p.points[0]), r"points: shape \(3,\), must be \(5, 3\)"),
        (lambda p: triangulation_angles_deg(p, p.points.T), r"points: shape \(3, 5\), must be \(5, 3\)"),
        (lambda p: reliable_points(p, p.points, max_error_px=0.0), "max_error_px = 0.0: must be finite"),
        (lambda p: reliable_points(p, p.points, min_angle_deg=-1.0), "min_angle_deg = -1.0: must be finite"),
        (lambda p: reliable_points(p, p.points, min_views=0), "min_views = 0: must be at least 1"),
    ],
)
def test_a_bad_argument_is_named_with_its_value(call: Any, message: str) -> None:
    with pytest.raises(InvalidArgument, match=message):
        call(circle_scene(3, 5))
