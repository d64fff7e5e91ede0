"""Repairs: what was broken is sound again, what was sound is left alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import sfmcpp
from faults import FAULTS
from sfmcpp import Problem, circle_scene, diagnose, perturb
from sfmcpp.doctor import repair

BY_NAME = {fault.name: fault for fault in FAULTS}


def sound() -> Problem:
    return perturb(circle_scene(12, 150, seed=4), point_sigma_m=0.1, rotation_sigma_deg=1, seed=4)


def solved_rms_px(problem: Problem) -> float:
    copy = problem.copy()
    return sfmcpp.solve(copy).final_rms_px


@pytest.mark.parametrize(
    "name",
    [
        "repeated observations",
        "an image given twice",
        "points given twice",
        "a point in a camera",
        "two parts",
        "y up",
        "outliers anywhere",
    ],
)
def test_a_repaired_problem_is_healthy_and_solves_as_the_sound_one(name: str) -> None:
    broken, _ = BY_NAME[name].broken(sound(), seed=9)
    assert not diagnose(broken).is_healthy
    mended = repair(broken)
    assert len(mended.done) == 1
    assert diagnose(mended.problem).is_healthy
    assert solved_rms_px(mended.problem) < 1.1 * solved_rms_px(sound())


def test_a_finding_tells_which_observations_are_outliers() -> None:
    problem = sound()
    wrong = np.arange(20, problem.num_observations, 97)
    problem.pixels[wrong] += 200
    # The doctor examines the problem without repeated observations, and still counts as the problem does.
    twice = np.concatenate([[0, 1, 2], np.arange(problem.num_observations)])
    (found,) = (f for f in diagnose(problem.with_observations(twice)).findings if f.code == "outliers")
    assert found.observations == tuple(wrong + 3)


def test_points_are_named_by_colmaps_identifiers_too() -> None:
    problem = sound().with_observations(~np.isin(sound().point_index, [3, 8]))
    problem.metadata.extra["colmap_point_ids"] = np.arange(problem.num_points) + 1000
    found = next(f for f in diagnose(problem).findings if f.code == "unobserved-points")
    assert found.where == "points 3, 8 (POINT3D_ID 1003, 1008)"
    (warning,) = sfmcpp.check(problem)
    assert warning == "points 3, 8, POINT3D_ID 1003, 1008: no observations, left as given"
    assert warning in sfmcpp.solve(problem.copy(), max_iterations=1).warnings
    many = sound().with_observations(sound().point_index >= 7)
    many.metadata.extra["colmap_point_ids"] = np.arange(many.num_points) + 1000
    assert sfmcpp.check(many)[0].startswith(
        "7 points (0, 1, 2, 3, 4, …), POINT3D_ID 1000, 1001, 1002, 1003, 1004, …: no observations"
    )


def test_a_sound_problem_is_left_alone() -> None:
    mended = repair(sound())
    assert mended.done == []
    np.testing.assert_array_equal(mended.problem.pixels, sound().pixels)


def test_several_faults_are_mended_one_after_the_other() -> None:
    problem = sound()
    for name in ("outliers anywhere", "y up", "repeated observations"):
        problem, _ = BY_NAME[name].broken(problem, seed=9)
    codes = [line.split(":")[0] for line in repair(problem).done]
    assert codes == ["duplicate-observations", "mirrored-y", "outliers"]


def test_what_cannot_be_mended_safely_is_left_as_it_is() -> None:
    broken, _ = BY_NAME["camera from world"].broken(sound(), seed=9)
    mended = repair(broken)
    assert mended.done == []
    np.testing.assert_array_equal(mended.problem.cameras, broken.cameras)


def test_cameras_and_points_keep_their_numbers() -> None:
    broken, _ = BY_NAME["two parts"].broken(sound(), seed=9)
    mended = repair(broken).problem
    assert (mended.num_cameras, mended.num_points) == (broken.num_cameras, broken.num_points)
    assert len(np.unique(mended.camera_index)) == broken.num_cameras // 2


@pytest.mark.parametrize("as_covariances", [False, True])
def test_observations_far_off_within_their_own_deviation_are_no_outliers(as_covariances: bool) -> None:
    problem, random = circle_scene(12, 200, pixel_sigma_px=0.0, seed=0), np.random.default_rng(0)
    sigmas = np.where(random.random(problem.num_observations) < 0.15, 6.0, 0.3)
    problem.pixels += sigmas[:, None] * random.normal(0, 1, problem.pixels.shape)
    wrong = np.flatnonzero(sigmas < 1)[::103]
    problem.pixels[wrong] += 5.0
    if as_covariances:
        problem = replace(problem, covariance_px2=sigmas[:, None, None] ** 2 * np.eye(2))
    else:
        problem.sigma_px = sigmas
    (found,) = (f for f in diagnose(problem).findings if f.code == "outliers")
    assert found.observations == tuple(wrong)
    assert "off by more than 3 px at the median σ" in str(found)
    assert repair(problem).problem.num_observations == problem.num_observations - len(wrong)


@pytest.mark.parametrize("known_sizes", [False, True])
def test_covariances_are_mirrored_with_their_pixels(known_sizes: bool) -> None:
    problem, random = circle_scene(12, 200, pixel_sigma_px=0.0, seed=1), np.random.default_rng(1)
    covariances = np.tile([[1.0, 0.8], [0.8, 1.5]], (problem.num_observations, 1, 1))
    problem.pixels += random.multivariate_normal([0, 0], covariances[0], problem.num_observations)
    right = replace(problem, covariance_px2=covariances)
    if not known_sizes:
        right.metadata.image_sizes = None
    mirrored = right.copy()
    mirrored.pixels[:, 1] = 480 - mirrored.pixels[:, 1]
    mirrored.covariance_px2 = covariances * [[1, -1], [-1, 1]]
    mended = repair(mirrored)
    assert mended.done == ["mirrored-y: y of all pixels mirrored"]
    np.testing.assert_array_equal(mended.problem.covariance_px2, covariances)
    np.testing.assert_allclose(mended.problem.pixels, right.pixels, atol=1e-9)
