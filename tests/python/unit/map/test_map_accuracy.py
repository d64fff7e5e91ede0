"""How well keypoints are measured: from the map into its problems, and back from problems."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import sfmcpp
from sfmcpp import InvalidArgument, Problem
from sfmcpp.geometry import robust_triangulation
from sfmcpp.geometry.duplicate_points import duplicate_points
from sfmcpp.map import Map, map_of_problem, problem_of_map, read_map, write_map


def world_with_scales(seed: int = 1) -> tuple[Map, Problem]:
    """A map whose keypoints have scales, and the problem it was made of."""
    problem = sfmcpp.circle_scene(5, 30, camera_model="perspective", pixel_sigma_px=0.0, seed=seed)
    world = map_of_problem(problem)
    world.keypoint_scales[:] = np.random.default_rng(seed).uniform(1, 8, len(world.keypoints))
    return world, problem


def test_nothing_is_said_of_keypoints_at_first() -> None:
    world, _ = world_with_scales()
    assert np.isnan(world.keypoint_covariances).all()
    for local in (world.whole_problem(), world.local_problem([0, 1])):
        assert local.problem.sigma_px is None
        assert local.problem.covariance_px2 is None


def test_scales_become_standard_deviations_of_every_problem() -> None:
    world, _ = world_with_scales()
    world.keypoint_scales[7] = np.nan
    world.set_sigmas_by_scale(0.25)
    world.points[3] = np.nan
    for local in (world.whole_problem(), world.local_problem([0, 1]), world.untriangulated([0, 1, 2])):
        scale = world.keypoint_scales[local.rows]
        expected = np.where(np.isnan(scale), 1.0, 0.25 * scale)
        assert local.problem.covariance_px2 is None
        np.testing.assert_array_equal(local.problem.sigma_px, expected)


def test_one_keypoint_that_is_not_round_makes_covariances_of_all() -> None:
    world, _ = world_with_scales()
    world.set_sigmas_by_scale(0.5)
    world.keypoint_covariances[11] = [4.0, 1.0, 2.0]
    world.keypoint_covariances[12] = np.nan
    local = world.whole_problem()
    assert local.problem.sigma_px is None
    expected = (0.5 * world.keypoint_scales[local.rows, None, None]) ** 2 * np.eye(2)
    expected[local.rows == 11] = [[4.0, 1.0], [1.0, 2.0]]
    expected[local.rows == 12] = np.eye(2)
    np.testing.assert_array_equal(local.problem.covariance_px2, expected)
    assert sfmcpp.solve(local.problem).final_cost < 1e-6


def test_triangulation_and_duplicates_take_the_problems_of_such_maps() -> None:
    world, truth = world_with_scales()
    world.keypoint_covariances[:] = [4.0, 1.0, 2.0]
    local = world.whole_problem()
    points, inliers = robust_triangulation(local.problem)
    assert inliers.all()
    np.testing.assert_allclose(points, truth.points, atol=1e-6)
    assert not len(duplicate_points(local.problem, points, tolerance_px=0.5))


def test_maps_that_join_bring_them_along() -> None:
    world, _ = world_with_scales(1)
    other, _ = world_with_scales(2)
    other.keypoint_covariances[:] = [2.0, 0.5, 1.0]
    before = len(world.keypoints)
    world.join(other)
    assert np.isnan(world.keypoint_covariances[:before]).all()
    np.testing.assert_array_equal(world.keypoint_covariances[before:], other.keypoint_covariances)


@pytest.mark.parametrize("kind", ["sigma_px", "covariance_px2"])
def test_a_map_keeps_what_a_problem_says_and_says_it_in_files(kind: str, tmp_path: Path) -> None:
    _, plain = world_with_scales()
    sigma = np.random.default_rng(3).uniform(0.5, 2, plain.num_observations)
    covariances = sigma[:, None, None] * np.array([[2.0, 0.5], [0.5, 1.0]])
    problem = replace(plain, **{kind: sigma if kind == "sigma_px" else covariances})
    world = map_of_problem(problem)
    write_map(world, tmp_path / "map.npz")
    expected = in_order(problem, getattr(problem, kind))
    for again in (problem_of_map(world), problem_of_map(read_map(tmp_path / "map.npz"))):
        np.testing.assert_allclose(in_order(again, getattr(again, kind)), expected, rtol=1e-15)


def in_order(problem: Problem, values: np.ndarray) -> np.ndarray:
    """Of observations by point and camera."""
    return np.asarray(values[np.lexsort((problem.camera_index, problem.point_index))])


@pytest.mark.parametrize("factor", [0.0, -1.0, np.nan, np.inf])
def test_a_factor_that_is_none_is_refused(factor: float) -> None:
    world, _ = world_with_scales()
    with pytest.raises(InvalidArgument, match="sigma_per_scale"):
        world.set_sigmas_by_scale(factor)


def test_a_least_standard_deviation_is_reached_by_no_keypoint_and_neared_by_fine_ones() -> None:
    world, _ = world_with_scales()
    world.set_sigmas_by_scale(0.1, least_px=0.3)
    expected = np.hypot(0.3, 0.1 * world.keypoint_scales)
    local = world.whole_problem()
    np.testing.assert_allclose(local.problem.sigma_px, expected[local.rows], rtol=1e-15)
    with pytest.raises(InvalidArgument, match="least_px"):
        world.set_sigmas_by_scale(0.1, least_px=-1.0)
