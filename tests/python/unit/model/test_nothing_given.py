"""Functions of arrays and problems that hold nothing, too little, or what is not finite."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import sfmcpp
from sfmcpp import InvalidArgument, Problem
from sfmcpp.geometry import fundamental_linear, pose_inliers, refine_points
from sfmcpp.sources.synthetic import hide_observations
from sfmcpp.study.evaluation import mean_3d_error, relative_pose_errors_deg
from sfmcpp.weighting import lowest, lowest_valley

SCENE = sfmcpp.circle_scene(4, 30, seed=0)
NO_POSES = np.zeros((0, 3, 4))


def problem_of(cameras: int, points: int) -> Problem:
    intrinsics = np.tile([1000.0, 1.0, 320.0, 240.0, 0.0], (cameras, 1))
    none = np.zeros(0, dtype=np.int32)
    poses = np.tile(np.eye(3, 4), (cameras, 1, 1))
    return Problem("calibrated", poses, intrinsics, np.ones((points, 3)), none, none, np.zeros((0, 2)))


@pytest.mark.parametrize(("cameras", "points"), [(0, 0), (0, 3), (3, 0)])
def test_a_problem_without_cameras_or_points_can_be_projective(cameras: int, points: int) -> None:
    projective = sfmcpp.as_projective(problem_of(cameras, points))
    assert projective.cameras.shape == (cameras, 3, 4)
    assert projective.points.shape == (points, 4)


def test_observations_of_no_cameras_cannot_be_hidden() -> None:
    with pytest.raises(InvalidArgument, match="no point is seen by two"):
        hide_observations(problem_of(0, 3), 0.1, seed=0)


def test_pixels_that_are_not_finite_are_refused_by_their_name() -> None:
    pixels = SCENE.pixels.copy()
    pixels[7, 1] = np.inf
    with pytest.raises(InvalidArgument, match=r"^pixels\[7, 1\] = inf: must be finite"):
        sfmcpp.projective_problem(SCENE.cameras, SCENE.points, SCENE.camera_index, SCENE.point_index, pixels)


@pytest.mark.parametrize("count", [0, 1, 7])
def test_eight_matches_are_the_fewest_of_a_fundamental_matrix(count: int) -> None:
    pixels = np.random.default_rng(0).uniform(0, 100, (count, 2))
    with pytest.raises(InvalidArgument, match=f"{count} matches, must be at least 8"):
        fundamental_linear(pixels, pixels)


def test_matches_that_are_not_finite_have_no_fundamental_matrix() -> None:
    pixels = np.random.default_rng(0).uniform(0, 100, (9, 2))
    spoilt = pixels.copy()
    spoilt[3, 0] = np.nan
    with pytest.raises(InvalidArgument, match=r"pixels_2\[3, 0\] = nan"):
        fundamental_linear(pixels, spoilt)


@pytest.mark.parametrize("choose", [lowest, lowest_valley])
def test_of_no_scores_the_first_is_the_lowest(choose) -> None:  # type: ignore[no-untyped-def]
    assert choose(np.zeros(0), np.zeros(0, dtype=bool)) == 0


def test_no_poses_have_no_pairs_and_no_mean_error() -> None:
    assert relative_pose_errors_deg(NO_POSES, NO_POSES).shape == (0,)
    with pytest.raises(InvalidArgument, match="0 poses"):
        mean_3d_error(NO_POSES, NO_POSES)


def test_an_estimate_without_a_finite_centre_is_missing() -> None:
    poses = SCENE.cameras.copy()
    poses[1, 2, 3] = np.nan
    errors = relative_pose_errors_deg(poses, SCENE.cameras)
    assert np.isinf(errors[[0, 3, 4]]).all()
    assert np.isfinite(errors[[1, 2, 5]]).all()


def test_points_at_infinity_stay_and_are_no_inliers() -> None:
    points = SCENE.points.copy()
    points[2], points[5] = np.inf, -np.inf
    chosen = SCENE.camera_index == 0
    seen = points[SCENE.point_index[chosen]]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        refined = refine_points(SCENE, points)
        inliers = pose_inliers(SCENE.cameras[0], seen, SCENE.pixels[chosen], SCENE.intrinsics[0], 5.0)
    np.testing.assert_array_equal(refined[[2, 5]], points[[2, 5]])
    assert np.isfinite(np.delete(refined, [2, 5], axis=0)).all()
    assert not inliers[~np.isfinite(seen).all(axis=1)].any()
    assert inliers.sum() == len(seen) - 2
