"""Points that are fixed, as surveyed ones, hold the cameras that see them."""

from __future__ import annotations

import numpy as np
import pytest

from faults import halves
from sfmcpp import Problem, circle_scene, diagnose, linearize
from sfmcpp.doctor import repair


def codes(problem: Problem) -> set[str]:
    return {finding.code for finding in diagnose(problem).findings}


def scene(cameras: int) -> Problem:
    return circle_scene(cameras, 60, pixel_sigma_px=0.5, seed=0)


@pytest.mark.parametrize(("known", "found"), [(60, set()), (5, set()), (3, {"weak-cameras"})])
def test_a_single_camera_before_fixed_points_is_determined(known: int, found: set[str]) -> None:
    problem = scene(3).with_cameras(np.arange(1)).with_points(np.arange(known))
    problem.fixed_points[:] = True
    jacobian = linearize(problem).jacobian().toarray()
    assert np.linalg.matrix_rank(jacobian) == 6 == jacobian.shape[1]
    assert codes(problem) == found


def test_cameras_at_one_place_need_no_baseline_before_fixed_points() -> None:
    problem = scene(8).with_cameras(np.arange(1)).with_points(np.arange(40))
    turned = Problem(
        problem.camera_model,
        np.repeat(problem.cameras, 3, axis=0),
        problem.intrinsics,
        problem.points,
        np.repeat(np.arange(3), 40),
        np.tile(problem.point_index, 3),
        np.tile(problem.pixels, (3, 1)),
        intrinsics_index=np.zeros(3, dtype=np.int32),
    )
    assert codes(turned) >= {"no-baseline"}
    turned.fixed_points[:] = True
    assert codes(turned) <= {"duplicate-cameras"}
    beside = turned.copy()
    beside.cameras[:, 0, 3] += [0.0, 1e-3, 2e-3]
    assert codes(beside) <= {"duplicate-cameras"}
    beside.fixed_points[:] = False
    assert codes(beside) >= {"pure-rotation"}


def test_outliers_of_a_single_camera_are_found_among_fixed_points_and_only_they_are_dropped() -> None:
    problem = scene(3).with_cameras(np.arange(1))
    problem.fixed_points[:] = True
    problem.pixels[[5, 17]] += [40.0, -30.0]
    (found,) = diagnose(problem).findings
    assert (found.code, found.observations) == ("outliers", (5, 17))
    kept = repair(problem).problem
    np.testing.assert_array_equal(kept.point_index, np.delete(problem.point_index, [5, 17]))


def test_a_single_camera_before_free_points_has_all_freedoms() -> None:
    problem = scene(3).with_cameras(np.arange(1))
    assert codes(problem) >= {"weak-cameras", "gauge-freedoms"}


@pytest.mark.parametrize(("known", "together"), [(2, False), (3, True), (10, True)])
def test_parts_that_see_enough_fixed_points_are_one(known: int, together: bool) -> None:
    problem = halves(scene(8), kept=0)
    sides = [np.unique(problem.point_index[problem.camera_index == camera]) for camera in (0, 7)]
    assert not np.intersect1d(*sides).size
    for side in sides:
        problem.fixed_points[side[:known]] = True
    assert ("disconnected-parts" not in codes(problem)) == together
    assert (len(np.unique(repair(problem).problem.camera_index)) == 8) == together


def test_a_part_of_a_fixed_camera_is_one_with_a_part_of_fixed_points() -> None:
    problem = halves(scene(8), kept=0)
    problem.fixed_cameras[0] = True
    problem.fixed_points[np.unique(problem.point_index[problem.camera_index == 7])] = True
    assert "disconnected-parts" not in codes(problem)
