"""Calibrations that cannot be right are named by check and solve, though the solve converges."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

import sfmcpp
from sfmcpp import Problem


def scene() -> Problem:
    """Images of 640 × 480 px."""
    problem = sfmcpp.perturb(
        sfmcpp.circle_scene(6, 60, camera_model="perspective", seed=1), point_sigma_m=0.02, seed=1
    )
    problem.metadata.image_sizes = np.tile([640, 480], (6, 1))
    return problem


def warnings_of(problem: Problem) -> list[str]:
    found = sfmcpp.check(problem)
    solved = sfmcpp.solve(problem.copy(), max_iterations=1).warnings
    assert set(found) <= set(solved)
    return found


def test_a_sound_problem_has_no_warning() -> None:
    assert ((scene().pixels > 0) & (scene().pixels < [640, 480])).all()
    assert warnings_of(scene()) == []
    single = scene()
    single.pixels[0] = [5000, 5000]  # an outlier
    assert warnings_of(single) == []


def test_pixels_of_larger_images_are_named() -> None:
    problem = scene()
    problem.metadata.image_sizes = problem.metadata.image_sizes // 2
    problem.intrinsics[:, [0, 2, 3]] /= 2
    (warning,) = warnings_of(problem)
    assert "of the observations are far outside of their images" in warning
    assert "in the 320 × 240 px of camera" in warning
    problem.pixels -= [320, 240]  # that count from the principal point
    problem.intrinsics[:, [2, 3]] = 0
    assert warnings_of(problem) == []


@pytest.mark.parametrize("sign", [1, -1])
def test_pixels_that_count_from_a_corner_are_named_where_they_should_not(sign: int) -> None:
    problem = scene()
    problem.pixels *= [1, sign]
    problem.intrinsics[:, [2, 3]] = 0
    problem.metadata.image_sizes = None
    (warning,) = warnings_of(problem)
    assert warning.startswith("principal points are 0, and all pixels to one side of them, ")
    assert warning.endswith("do they count from a corner of the image? Run sfmcpp doctor")


def test_focal_lengths_that_are_not_positive_are_named() -> None:
    problem = scene()
    problem.intrinsics[problem.intrinsics_index[2], 0] *= -1
    (warning,) = warnings_of(problem)
    assert warning.startswith("intrinsics row")
    assert ": the focal length f is not positive" in warning


def doctor_warnings(problem: Problem, **options: Any) -> list[str]:
    return [warning for warning in sfmcpp.solve(problem, **options).warnings if "doctor" in warning]


def test_a_start_that_explains_nothing_is_sent_to_the_doctor() -> None:
    truth = sfmcpp.circle_scene(12, 200, camera_model="perspective", pixel_sigma_px=1.0, seed=1)
    truth.cameras[:, :, 3] += [3.0, 1.0, 0.0]  # its centres and translations are alike else
    truth.points += [3.0, 1.0, 0.0]
    turned = np.swapaxes(truth.rotations, 1, 2)
    wrong = truth.copy()  # poses as camera_from_world
    wrong.rotations[:] = turned
    wrong.centres[:] = -np.einsum("cij,cj->ci", turned, truth.centres)
    (warning,) = doctor_warnings(wrong, max_iterations=20)
    assert warning.startswith("the start explains nothing: its RMS is ")
    far = sfmcpp.perturb(truth, point_sigma_m=2, position_sigma_m=2, rotation_sigma_deg=10, seed=1)
    summary = sfmcpp.solve(far)
    assert summary.initial_rms_px > 100 > 1 > summary.final_rms_px
    assert summary.warnings == []


def test_a_solve_that_ends_with_many_points_behind_cameras_is_sent_to_the_doctor() -> None:
    problem = scene()
    problem.points[:20] += 2 * (problem.centres[0] - problem.points[:20])  # behind the first camera
    problem = problem.with_observations((problem.camera_index == 0) | (problem.point_index >= 20))
    (warning,) = doctor_warnings(problem, max_iterations=1)
    assert warning.endswith("of the observations are behind their camera at the end; run sfmcpp doctor")


def test_standard_deviations_beside_which_residuals_say_nothing_are_named() -> None:
    moved = sfmcpp.perturb(scene(), position_sigma_m=0.1, seed=1)
    moved.sigma_px = np.full(moved.num_observations, 1e12)
    (warning,) = sfmcpp.solve(moved).warnings
    assert "before the first step" in warning
    assert "(1e+12 px in the median)" in warning
    moved.sigma_px[:] = 2.0
    assert not sfmcpp.solve(moved).warnings
    assert not sfmcpp.solve(moved).warnings  # again, from the minimum


@pytest.mark.parametrize("stated", ["sigma_px", "covariance_px2"])
def test_uncertainties_that_leave_nothing_to_fit_are_named(stated: str) -> None:
    problem = scene()
    count = problem.num_observations
    if stated == "sigma_px":
        problem.sigma_px = np.full(count, 1e12)
    else:
        problem.covariance_px2 = np.tile(1e24 * np.eye(2), (count, 1, 1))
    (warning,) = sfmcpp.solve(problem).warnings
    assert "the σ of observations (1e+12 px in the median) are so large that they say nothing" in warning


@pytest.mark.parametrize("model", ["calibrated", "perspective", "bal"])
@pytest.mark.parametrize("f", [4.25, -4.25, 26.0])
def test_focal_lengths_in_millimetres_are_named(model: str, f: float) -> None:
    problem = sfmcpp.circle_scene(6, 60, camera_model=model, seed=1)
    assert warnings_of(problem) == []
    problem.intrinsics[:, 0] = f
    named = [warning for warning in sfmcpp.check(problem) if "is f in mm?" in warning]
    assert [warning.startswith(f"f = {abs(f):g} px, with pixels ") for warning in named] == [True]
    assert set(named) <= set(sfmcpp.solve(problem, max_iterations=1).warnings)


@pytest.mark.parametrize("unit", [1e-3, 1.0])
def test_wide_views_and_other_units_of_pixels_and_focal_length_alike_are_sound(unit: float) -> None:
    """A view of 120° across, and image points at depth one or in mm."""
    problem = sfmcpp.circle_scene(6, 60, seed=1)
    radius = np.abs(problem.pixels - problem.intrinsics[0, 2:4]).max()
    problem.intrinsics[:, 0] = radius / np.tan(np.radians(60))
    problem.intrinsics[:, [0, 2, 3]] *= unit
    problem.pixels *= unit
    assert not [warning for warning in sfmcpp.check(problem) if "is f in mm?" in warning]


def test_pixels_whose_squares_are_infinite_raise_no_warning_of_numpy() -> None:
    problem = scene()
    problem.pixels[3] = 1e300
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        summary = sfmcpp.solve(problem, loss="huber", loss_scale_px=1.0)
    assert summary.termination == "numerical_failure"
