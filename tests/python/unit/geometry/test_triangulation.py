"""Linear, midpoint and refined triangulation against truth and slow references, one point at a time."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize, minimize_scalar
from scipy.spatial.transform import Rotation

from random_scenes import Array, project, ragged_problem, residuals_of, views_of
from sfmcpp import InvalidArgument, Problem, as_projective, circle_scene
from sfmcpp.geometry import (
    depths,
    refine_points,
    reprojection_errors_px,
    triangulate_linear,
    triangulate_midpoint,
    triangulate_optimal,
)

SEEDS = st.integers(0, 2**32 - 1)
MULTI_VIEW = [triangulate_linear, triangulate_midpoint]
Triangulate = Callable[[Problem], Array]


def triangulate_refined(problem: Problem) -> Array:
    """Least squares on the pixels from the linear solution, for any number of views."""
    return refine_points(problem, triangulate_linear(problem))


ALL = [*MULTI_VIEW, triangulate_refined, triangulate_optimal]


def two_view_problem(seed: int, sigma_px: float, num_points: int = 40) -> Problem:
    """Points seen by two cameras each, any two of five, in random order."""
    problem = ragged_problem(seed, num_points, 5, sigma_px)
    order = np.argsort(problem.point_index, kind="stable")
    first = np.searchsorted(problem.point_index[order], np.arange(num_points))
    kept = np.random.default_rng(seed).permutation(order[np.concatenate([first, first + 1])])
    return with_observations(problem, kept)


def with_observations(problem: Problem, kept: Array) -> Problem:
    return dataclasses.replace(
        problem,
        camera_index=problem.camera_index[kept],
        point_index=problem.point_index[kept],
        pixels=problem.pixels[kept],
    )


def cost(problem: Problem, point: int, position: Array) -> float:
    return float(np.sum(residuals_of(views_of(problem, point), position) ** 2))


@pytest.mark.parametrize("triangulate", MULTI_VIEW)
@settings(max_examples=20, deadline=None)
@given(seed=SEEDS)
def test_exact_ragged_tracks_give_the_true_points(triangulate: Triangulate, seed: int) -> None:
    problem = ragged_problem(seed)
    np.testing.assert_allclose(triangulate(problem), problem.points, rtol=1e-7, atol=1e-7)


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS)
def test_exact_matches_give_the_true_points(seed: int) -> None:
    problem = two_view_problem(seed, 0.0)
    for triangulate in (triangulate_refined, triangulate_optimal):
        np.testing.assert_allclose(triangulate(problem), problem.points, rtol=1e-6, atol=1e-6)


def test_linear_is_the_singular_vector_of_the_stacked_rows() -> None:
    problem = ragged_problem(1, sigma_px=2.0)
    found = triangulate_linear(problem)
    rows = problem.intrinsics[problem.intrinsics_index]
    for point in range(problem.num_points):
        seen = np.flatnonzero(problem.point_index == point)
        centres = problem.centres[problem.camera_index[seen]]
        origin = centres.mean(axis=0)
        length = np.sqrt(np.mean(np.sum((centres - origin) ** 2, axis=1)))
        frame = np.block([[length * np.eye(3), origin[:, None]], [np.zeros(3), 1.0]])
        stacked = []
        for m in seen:
            c = problem.camera_index[m]
            f, aspect, cx, cy, skew = rows[c]
            y = (problem.pixels[m, 1] - cy) / (aspect * f)
            x = (problem.pixels[m, 0] - cx - skew * y) / f
            matrix = np.linalg.inv(np.vstack([problem.cameras[c], [0, 0, 0, 1]]))[:3] @ frame / length
            stacked += [x * matrix[2] - matrix[0], y * matrix[2] - matrix[1]]
        null = np.linalg.svd(np.array(stacked))[2][-1]
        expected = origin + length * null[:3] / null[3]
        np.testing.assert_allclose(found[point], expected, rtol=1e-7, atol=1e-7)


def test_midpoint_is_nearest_to_all_rays() -> None:
    problem = ragged_problem(2, 15, sigma_px=3.0)
    found = triangulate_midpoint(problem)
    for point in range(problem.num_points):
        views = views_of(problem, point)
        centres = [-np.linalg.solve(p[:, :3], p[:, 3]) for p, _ in views]
        directions = [np.linalg.solve(p[:, :3], np.append(pixel, 1.0)) for p, pixel in views]

        def squares(x: Array, centres: list[Array] = centres, directions: list[Array] = directions) -> float:
            across = [
                np.cross(d / np.linalg.norm(d), x - c) for c, d in zip(centres, directions, strict=True)
            ]
            return float(np.sum(np.square(across)))

        best = minimize(
            squares, problem.points[point], method="Nelder-Mead", options={"xatol": 1e-10, "fatol": 1e-16}
        )
        np.testing.assert_allclose(found[point], best.x, atol=1e-5)
        assert squares(found[point]) <= best.fun * (1 + 1e-9)


def test_midpoint_of_two_rays_is_in_the_middle_of_their_shortest_connection() -> None:
    cameras = np.stack([np.eye(3, 4), np.column_stack([np.eye(3), [1.0, 0.2, 0.0]])])
    pixels = [[0.25, 0.0], [0.0, 0.0]]
    problem = Problem(
        "calibrated", cameras, np.tile([1.0, 1, 0, 0, 0], (2, 1)), np.zeros((1, 3)), [0, 1], [0, 0], pixels
    )
    # Ray 1 runs in the plane y = 0, ray 2 along z through (1, 0.2): nearest where ray 1 has x = 1.
    np.testing.assert_allclose(triangulate_midpoint(problem), [[1.0, 0.1, 4.0]], atol=1e-12)


@pytest.mark.parametrize("triangulate", ALL)
def test_points_follow_a_similarity_of_the_world(triangulate: Triangulate) -> None:
    problem = two_view_problem(3, 1.0)
    rotation, shift = Rotation.from_rotvec([1.0, -2.0, 0.5]).as_matrix(), np.array([300.0, -200.0, 50.0])
    moved = problem.copy()
    moved.cameras = np.concatenate(
        [rotation @ problem.rotations, (5 * problem.centres @ rotation.T + shift)[:, :, None]], axis=2
    )
    expected = 5 * triangulate(problem) @ rotation.T + shift
    np.testing.assert_allclose(triangulate(moved), expected, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("triangulate", ALL)
def test_the_order_of_the_observations_does_not_matter(triangulate: Triangulate) -> None:
    problem = two_view_problem(4, 1.0)
    kept = np.random.default_rng(4).permutation(problem.num_observations)
    shuffled = triangulate(with_observations(problem, kept))
    np.testing.assert_allclose(shuffled, triangulate(problem), rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("triangulate", MULTI_VIEW)
def test_open_points_are_not_a_number_and_leave_the_others_alone(triangulate: Triangulate) -> None:
    problem = ragged_problem(5, 6)
    expected = triangulate(problem)
    once = np.flatnonzero(problem.point_index == 2)[1:]
    never = np.flatnonzero(problem.point_index == 4)
    found = triangulate(
        with_observations(problem, np.setdiff1d(np.arange(problem.num_observations), [*once, *never]))
    )
    np.testing.assert_array_equal(np.isnan(found).all(axis=1), [False, False, True, False, True, False])
    np.testing.assert_allclose(found[[0, 1, 3, 5]], expected[[0, 1, 3, 5]], rtol=1e-9)


@pytest.mark.parametrize("triangulate", ALL)
def test_parallel_rays_and_equal_centres_give_no_point(triangulate: Triangulate) -> None:
    aside, same = np.eye(3, 4), np.eye(3, 4)
    aside[0, 3] = 1.0
    problem = Problem(
        "calibrated",
        np.stack([np.eye(3, 4), aside, same]),
        np.tile([500.0, 1, 320, 240, 0], (3, 1)),
        np.zeros((3, 3)),
        [0, 1, 0, 2, 0, 1],
        [0, 0, 1, 1, 2, 2],
        [[320, 240], [320, 240], [320, 240], [330, 240], [320, 240], [220, 240]],
    )
    np.testing.assert_allclose(triangulate(problem), [[np.nan] * 3, [np.nan] * 3, [0, 0, 5]], atol=1e-9)


@pytest.mark.parametrize("triangulate", [triangulate_refined, triangulate_optimal])
@settings(max_examples=10, deadline=None)
@given(seed=SEEDS, sigma_px=st.floats(0.3, 4.0))
def test_no_point_on_any_epipolar_plane_is_better(
    triangulate: Triangulate, seed: int, sigma_px: float
) -> None:
    problem = two_view_problem(seed, sigma_px, 8)
    found = triangulate(problem)
    tested = np.ones(problem.num_points, dtype=np.bool_)
    if triangulate is triangulate_refined:
        # Steps from the linear solution do not lead past infinity, where noise moves points on parallel rays.
        np.logical_and.at(tested, problem.point_index, depths(problem, found) > 0)
    for point in np.flatnonzero(tested):
        assert (
            cost(problem, point, found[point])
            <= best_over_epipolar_planes(problem, point) * (1 + 1e-6) + 1e-12
        )


def best_over_epipolar_planes(problem: Problem, point: int) -> float:
    """Least sum of squared distances to a pair of epipolar lines, by search over all pairs."""
    views = views_of(problem, point)
    centres = [-np.linalg.solve(matrix[:, :3], matrix[:, 3]) for matrix, _ in views]
    across = np.linalg.svd((centres[1] - centres[0])[None])[2][1:]

    def squares(angles: Array) -> Array:
        directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1) @ across
        total = np.zeros(np.shape(angles))
        for (matrix, pixel), other in zip(views, centres[::-1], strict=True):
            line = np.cross(matrix @ np.append(other, 1.0), directions @ matrix[:, :3].T)
            total += (line @ np.append(pixel, 1.0)) ** 2 / (line[..., :2] ** 2).sum(-1)
        return total

    angles = np.linspace(0, np.pi, 2001)
    coarse = squares(angles)
    near = angles[coarse.argmin()]
    tight = {"xatol": 1e-12}
    bounds = (near - angles[1], near + angles[1])
    return min(
        float(minimize_scalar(squares, bounds=bounds, method="bounded", options=tight).fun), coarse.min()
    )


def test_refined_is_nowhere_worse_than_the_other_methods_and_better_than_the_truth() -> None:
    problem = two_view_problem(6, 1.5, 100)
    costs = {
        name: np.array([cost(problem, point, x) for point, x in enumerate(points)])
        for name, points in {
            "refined": triangulate_refined(problem),
            "optimal": triangulate_optimal(problem),
            "linear": triangulate_linear(problem),
            "midpoint": triangulate_midpoint(problem),
            "truth": problem.points,
        }.items()
    }
    # Nearly parallel rays may meet behind the cameras: such a point is not refined.
    behind = np.isinf(reprojection_errors_px(problem, triangulate_linear(problem)))
    refined = ~np.isin(np.arange(100), problem.point_index[behind])
    assert np.count_nonzero(refined) == 99
    for other in ("linear", "midpoint", "truth"):
        assert (costs["refined"] <= costs[other] * (1 + 1e-9))[refined].all()
        assert costs["refined"].sum() < 0.999 * costs[other].sum()
        # The global minimum may lie behind the cameras too.
        assert (costs["optimal"] <= costs[other] * (1 + 1e-9)).all()
    np.testing.assert_allclose(costs["optimal"][refined], costs["refined"][refined], rtol=1e-6)


def test_optimal_weighs_observations_and_refines_longer_tracks_and_lenses() -> None:
    pair, tracks = two_view_problem(7, 2.0), ragged_problem(8, sigma_px=1.0)
    lens = np.array([0.1, -0.02, 0, 0, 0, 1e-3, -1e-3])
    rows = np.concatenate([pair.intrinsics, np.tile(lens, (len(pair.intrinsics), 1))], axis=1)
    for problem in (pair, tracks, dataclasses.replace(pair, camera_model="perspective", intrinsics=rows,
                                                      fixed_intrinsics=None)):  # fmt: skip
        problem.sigma_px = np.random.default_rng(7).uniform(0.3, 3.0, problem.num_observations)
        found = triangulate_optimal(problem)
        in_front = np.isfinite(reprojection_errors_px(problem, found))
        best = refine_points(problem, found)
        of_good = np.setdiff1d(np.arange(problem.num_points), problem.point_index[~in_front])
        assert len(of_good) > 30
        np.testing.assert_allclose(found[of_good], best[of_good], rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("triangulate", MULTI_VIEW)
def test_the_circular_scene_is_found_to_the_accuracy_of_its_pixels(triangulate: Triangulate) -> None:
    problem = circle_scene(10, 200, pixel_sigma_px=1.0, seed=8)
    # A ray is off by about 20 m / 1000 px; ten rays all round average that down.
    rms = np.sqrt(np.mean(np.sum((triangulate(problem) - problem.points) ** 2, axis=1)))
    assert 0.005 < rms < 0.02


@pytest.mark.parametrize("triangulate", ALL)
def test_a_bad_problem_is_named(triangulate: Triangulate) -> None:
    with pytest.raises(InvalidArgument, match="camera_model = 'projective': must be 'calibrated'"):
        triangulate(as_projective(circle_scene(2, 5)))
    problem = circle_scene(2, 5)
    problem.pixels[3, 1] = np.nan
    with pytest.raises(InvalidArgument, match=r"pixels\[3, 1\] = nan: must be finite"):
        triangulate(problem)
    problem = circle_scene(2, 5)
    problem.camera_index[4] = 2
    with pytest.raises(InvalidArgument, match=r"camera_index\[4\] = 2: must be from 0 to 1"):
        triangulate(problem)


def test_projection_helper_agrees_with_the_scene() -> None:
    problem = circle_scene(3, 20, pixel_sigma_px=0.0, seed=9)
    seen = problem.camera_index == 1
    expected = project(problem.cameras[1], problem.intrinsics[1], problem.points[problem.point_index[seen]])
    np.testing.assert_allclose(problem.pixels[seen], expected, atol=1e-9)
