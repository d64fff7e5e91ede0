"""Points that are one, where tracks were torn and the truth is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from projective_scenes import metric_scene
from sfmcpp import Problem
from sfmcpp.geometry.duplicate_points import duplicate_points, merged_tracks

IntArray = NDArray[np.intp]


def torn(seed: int) -> tuple[Problem, IntArray]:
    """Every track in two, one of the first six cameras and one of the others; what each point was before."""
    whole = metric_scene("turntable", seed, num_points=80)
    pieces = 2 * whole.point_index + (whole.camera_index >= 6)
    numbers, index = np.unique(pieces, return_inverse=True)
    before = numbers // 2
    torn_problem = replace(
        whole,
        points=whole.points[before],
        point_index=index.astype(np.int32),
        fixed_points=whole.fixed_points[before],
    )
    return torn_problem, before


def test_torn_tracks_are_found_and_nothing_else() -> None:
    for seed in range(5):
        problem, before = torn(seed)
        pairs = duplicate_points(problem, problem.points, tolerance_px=1.0, max_angle_deg=90.0)
        assert (before[pairs[:, 0]] == before[pairs[:, 1]]).all()
        both = np.bincount(before) == 2
        assert len(pairs) == np.count_nonzero(both)


def test_a_torn_track_beside_itself_is_found_with_the_tolerance_that_it_takes() -> None:
    problem, _ = torn(1)
    moved = problem.points.copy()
    moved[:] += np.random.default_rng(0).normal(0, 0.02, moved.shape)  # a pixel is 0.02 m
    narrow = duplicate_points(problem, moved, tolerance_px=0.1, max_angle_deg=90.0)
    wide = duplicate_points(problem, moved, tolerance_px=6.0, max_angle_deg=90.0)
    assert len(narrow) < len(wide)


def test_points_that_one_image_sees_are_two() -> None:
    problem = metric_scene("turntable", 2, num_points=40)
    doubled = replace(
        problem,
        points=np.repeat(problem.points, 2, axis=0),
        point_index=2 * problem.point_index,
        fixed_points=np.repeat(problem.fixed_points, 2),
    )
    doubled.points[1::2] = np.nan  # seen by nothing
    assert len(duplicate_points(doubled, doubled.points, tolerance_px=5.0)) == 0


def test_points_seen_from_opposite_sides_are_two() -> None:
    problem, _ = torn(3)
    assert len(duplicate_points(problem, problem.points, tolerance_px=1.0, max_angle_deg=5.0)) == 0


def test_merged_tracks_have_one_observation_in_an_image() -> None:
    problem, before = torn(4)
    pairs = duplicate_points(problem, problem.points, tolerance_px=1.0, max_angle_deg=90.0)
    merged = merged_tracks(problem, pairs)
    np.testing.assert_array_equal(before[merged], before[problem.point_index])
    assert len(np.unique(merged)) == len(np.unique(before))


def test_a_chain_that_would_see_a_point_twice_is_not_closed() -> None:
    problem, _ = torn(5)
    cameras = np.array([0, 1, 2, 3, 4, 5, 0, 1], dtype=np.int32)
    points = np.array([0, 0, 1, 1, 2, 2, 3, 3], dtype=np.int32)
    chain = replace(problem, camera_index=cameras, point_index=points, pixels=np.zeros((8, 2)))
    merged = merged_tracks(chain, np.array([[0, 1], [1, 2], [2, 3]]))
    # 0, 1 and 2 become one; 3 is seen by the cameras of 0.
    np.testing.assert_array_equal(merged, [0, 0, 0, 0, 0, 0, 3, 3])
