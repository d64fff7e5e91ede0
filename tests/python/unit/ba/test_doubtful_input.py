"""Calibrations that cannot be right are named by check and solve, though the solve converges."""

from __future__ import annotations

import numpy as np

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


def test_focal_lengths_that_are_not_positive_are_named() -> None:
    problem = scene()
    problem.intrinsics[problem.intrinsics_index[2], 0] *= -1
    (warning,) = warnings_of(problem)
    assert warning.startswith("the focal length of ")
    assert "cameras is not positive: f = -" in warning
