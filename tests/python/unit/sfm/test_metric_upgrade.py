"""Metric upgrades against the truth, and where there is none, the reason."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from projective_scenes import FOCAL, SIZE, metric_scene, projective_scene
from sfmcpp import InvalidArgument, Problem, add_outliers, residuals, solve
from sfmcpp.geometry import depths, fit_similarity
from sfmcpp.map.files import map_of_problem
from sfmcpp.sfm.batch.upgrade import MetricUpgrade, metric_upgrade


def upgraded(result: MetricUpgrade) -> Problem:
    assert result.problem is not None, result.reason
    return result.problem


def centre_error(problem: Problem, truth: Problem) -> float:
    """Largest error of a centre after the best similarity [m]; cameras are 20 m from the scene."""
    place = fit_similarity(problem.centres, truth.centres)
    return float(np.linalg.norm(place.apply(problem.centres) - truth.centres, axis=1).max())


@pytest.mark.parametrize("motion", ["turntable", "fixating", "general"])
@pytest.mark.parametrize("focal", ["shared", "varying"])
def test_exact_observations_give_back_the_scene(motion: str, focal: str) -> None:
    truth = metric_scene(motion, 1)
    result = metric_upgrade(projective_scene(truth, 1), SIZE, focal=focal, threads=1)
    problem = upgraded(result)
    np.testing.assert_allclose(problem.intrinsics[:, 0], FOCAL, rtol=1e-6)
    assert centre_error(problem, truth) < 1e-4
    assert (depths(problem, problem.points) > 0).all()
    assert problem.num_observations == truth.num_observations


@pytest.mark.parametrize("motion", ["turntable", "general"])
def test_noise_moves_the_focal_length_as_much_as_is_stated(motion: str) -> None:
    deviations = []
    for seed in range(8):
        truth = metric_scene(motion, seed, sigma_px=1.0)
        result = metric_upgrade(projective_scene(truth, seed), SIZE, threads=1)
        problem = upgraded(result)
        deviations.append((problem.intrinsics[0, 0] / FOCAL - 1) / result.focal_sigma)
        assert centre_error(problem, truth) < 0.5
    assert 0.4 < np.sqrt(np.mean(np.square(deviations))) < 1.8


@pytest.mark.parametrize("motion", ["line", "nadir"])
@pytest.mark.parametrize("sigma_px", [0.0, 1.0])
def test_a_critical_motion_is_said_to_be_one(motion: str, sigma_px: float) -> None:
    for seed in range(2):
        truth = metric_scene(motion, seed, sigma_px=sigma_px)
        result = metric_upgrade(projective_scene(truth, seed), SIZE, threads=1)
        assert result.problem is None
        assert "focal length" in result.reason or "calibration" in result.reason


def test_known_cameras_are_upgraded_whatever_their_motion() -> None:
    for motion in ("line", "nadir", "turntable"):
        truth = metric_scene(motion, 3, sigma_px=0.5)
        known = [FOCAL, 1.0, SIZE[0] / 2, SIZE[1] / 2, 0.0]
        result = metric_upgrade(projective_scene(truth, 3), SIZE, focal="known", intrinsics=known, threads=1)
        problem = upgraded(result)
        np.testing.assert_array_equal(problem.intrinsics[:, :5], np.tile(known, (len(problem.intrinsics), 1)))
        assert centre_error(problem, truth) < 0.5


def test_a_wrong_calibration_is_noticed() -> None:
    truth = metric_scene("general", 4, sigma_px=0.5)
    wrong = [FOCAL, 2.0, 0.0, 0.0, 0.0]
    result = metric_upgrade(projective_scene(truth, 4), SIZE, focal="known", intrinsics=wrong, threads=1)
    assert result.problem is None
    assert "known" in result.reason


def test_cameras_that_zoom_are_not_taken_silently_for_one() -> None:
    truth = metric_scene("general", 12, sigma_px=0.3)
    zoom = np.linspace(0.8, 1.25, 12)[truth.camera_index, None]
    centre = np.array(SIZE) / 2
    zoomed = replace(truth, pixels=centre + zoom * (truth.pixels - centre))
    start = projective_scene(zoomed, 12)
    shared = metric_upgrade(start, SIZE, focal="shared", threads=1)
    assert shared.problem is None or any("times worse" in warning for warning in shared.warnings)
    varying = metric_upgrade(start, SIZE, focal="varying", threads=1)
    focals = upgraded(varying).intrinsics[:, 0]
    np.testing.assert_allclose(focals, FOCAL * np.linspace(0.8, 1.25, 12), rtol=5 * varying.focal_sigma)
    assert not varying.warnings


def test_outliers_are_left_out_and_what_is_kept_is_told() -> None:
    truth = metric_scene("general", 6, sigma_px=0.5)
    start = projective_scene(truth, 6)
    spoilt, wrong = add_outliers(replace(start, metadata=truth.metadata), 0.1, seed=1)
    result = metric_upgrade(spoilt, SIZE, threads=1)
    problem = upgraded(result)
    assert np.count_nonzero(wrong[result.observations]) < 0.02 * np.count_nonzero(wrong)
    assert np.count_nonzero(~wrong[result.observations]) > 0.97 * np.count_nonzero(~wrong)
    np.testing.assert_array_equal(problem.pixels, spoilt.pixels[result.observations])
    np.testing.assert_array_equal(result.points[problem.point_index], spoilt.point_index[result.observations])
    assert abs(problem.intrinsics[0, 0] / FOCAL - 1) < 4 * result.focal_sigma


def test_a_camera_that_sees_too_little_is_left_out_and_named() -> None:
    truth = metric_scene("general", 7)
    few = np.flatnonzero(truth.camera_index == 5)[3:]
    kept = np.setdiff1d(np.arange(truth.num_observations), few)
    start = projective_scene(truth, 7, adjusted=False)
    start = replace(
        start,
        camera_index=start.camera_index[kept],
        point_index=start.point_index[kept],
        pixels=start.pixels[kept],
    )
    result = metric_upgrade(start, SIZE, threads=1)
    np.testing.assert_array_equal(result.cameras, np.delete(np.arange(12), 5))
    assert "5" in result.warnings[0]
    others = replace(truth, cameras=truth.cameras[result.cameras], camera_index=np.zeros(0, np.int32),
                     point_index=np.zeros(0, np.int32), pixels=np.zeros((0, 2)),
                     intrinsics=truth.intrinsics[result.cameras], intrinsics_index=None,
                     fixed_cameras=None, fixed_intrinsics=None)  # fmt: skip
    assert centre_error(upgraded(result), others) < 1e-4


def test_the_start_is_left_alone_and_threads_change_no_bit() -> None:
    truth = metric_scene("turntable", 8, sigma_px=0.5)
    start = projective_scene(truth, 8)
    copy = start.copy()
    first, second = (upgraded(metric_upgrade(start, SIZE, threads=n)) for n in (1, 2))
    for name in ("cameras", "points", "pixels", "point_index", "camera_index"):
        np.testing.assert_array_equal(getattr(start, name), getattr(copy, name))
        assert getattr(first, name).tobytes() == getattr(second, name).tobytes()


def test_an_upgrade_without_adjustment_is_where_one_starts() -> None:
    truth = metric_scene("turntable", 11, sigma_px=1.0)
    start = projective_scene(truth, 11)
    found = metric_upgrade(start, SIZE, adjusted=False, threads=1)
    problem = upgraded(found)
    assert len(found.observations) == problem.num_observations == truth.num_observations
    before = np.sqrt(np.mean(residuals(problem) ** 2))
    solve(problem, threads=1)
    after = np.sqrt(np.mean(residuals(problem) ** 2))
    assert after < 0.97 * before < 20
    assert centre_error(problem, truth) < 0.5


def test_the_result_becomes_a_map() -> None:
    truth = metric_scene("turntable", 9, sigma_px=0.5)
    world = map_of_problem(upgraded(metric_upgrade(projective_scene(truth, 9), SIZE, threads=1)))
    assert world.registered.all()
    assert world.known.any()
    assert len(world.intrinsics) == 1


def with_torn_tracks(problem: Problem, length: int) -> Problem:
    """Tracks end after that many images, each point's elsewhere, and all after the last image."""
    pieces = (problem.camera_index + problem.point_index % length) // length + 100 * problem.point_index
    numbers, index = np.unique(pieces, return_inverse=True)
    return replace(
        problem,
        points=problem.points[numbers // 100],
        point_index=index.astype(np.int32),
        fixed_points=problem.fixed_points[numbers // 100],
    )


def test_a_turn_all_the_way_round_is_closed_where_no_track_does() -> None:
    truth = metric_scene("turntable", 10, sigma_px=0.3, num_cameras=36, num_points=200)
    start = with_torn_tracks(projective_scene(truth, 10), 6)
    torn, merged = (
        upgraded(metric_upgrade(start, SIZE, merge_tracks=merge, threads=1)) for merge in (False, True)
    )
    assert merged.num_points < 0.4 * torn.num_points
    assert centre_error(merged, truth) < 0.5 * centre_error(torn, truth)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sizes": (640, 0)}, "sizes"),
        ({"sizes": np.ones((3, 2))}, "sizes"),
        ({"focal": "zoom"}, "focal"),
        ({"focal": "known"}, "intrinsics"),
        ({"intrinsics": [1.0, 1, 0, 0, 0]}, "intrinsics"),
        ({"aspect": 0.0}, "aspect"),
        ({"distortion": 6}, "distortion"),
        ({"min_views": 1}, "min_views"),
        ({"max_error_px": -1.0}, "max_error_px"),
    ],
)
def test_arguments_out_of_range_are_refused(change: dict[str, object], message: str) -> None:
    start = projective_scene(metric_scene("general", 0), 0, adjusted=False)
    with pytest.raises(InvalidArgument, match=message):
        metric_upgrade(start, **{"sizes": SIZE, **change})  # type: ignore[arg-type]


def test_a_metric_problem_is_refused() -> None:
    with pytest.raises(InvalidArgument, match="projective"):
        metric_upgrade(metric_scene("general", 0), SIZE)


def test_too_few_cameras_are_a_reason() -> None:
    start = projective_scene(metric_scene("general", 0, num_cameras=2), 0, adjusted=False)
    assert "at least 3" in metric_upgrade(start, SIZE).reason
