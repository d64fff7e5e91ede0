"""Errors of a projective reconstruction: blind to the frame of the world, and to nothing else."""

from __future__ import annotations

import numpy as np
import pytest

import sfmcpp
from sfmcpp.errors import InvalidArgument
from sfmcpp.study.evaluation.projective import projective_errors_px


def test_any_frame_of_the_true_world_has_no_error() -> None:
    truth = sfmcpp.corridor_scene(8, 300, length_m=6)
    rng = np.random.default_rng(2)
    frame = np.eye(4) + 0.5 * rng.standard_normal((4, 4))
    points = np.c_[truth.points, np.ones(truth.num_points)] @ np.linalg.inv(frame).T
    cameras = sfmcpp.projection_matrices(truth) @ frame * rng.uniform(0.5, 2, (8, 1, 1))
    estimate = sfmcpp.projective_problem(cameras, points, truth.camera_index, truth.point_index, truth.pixels)
    assert projective_errors_px(estimate, truth).max() < 1e-6


def test_a_point_that_moved_has_the_error_that_the_true_cameras_see() -> None:
    truth = sfmcpp.circle_scene(8, 60, pixel_sigma_px=0.0)
    moved = truth.copy()
    moved.points[7] += [0.1, 0.0, 0.0]
    trusted = truth.point_index != 7
    error = projective_errors_px(moved, truth, trusted)
    expected = np.linalg.norm(np.asarray(sfmcpp.residuals(moved)).reshape(-1, 2), axis=1)
    np.testing.assert_allclose(error, expected, atol=1e-6)
    assert error[~trusted].min() > 0.1


def test_noise_of_the_points_is_seen_as_it_is() -> None:
    truth = sfmcpp.circle_scene(10, 200)
    noisy = sfmcpp.perturb(truth, point_sigma_m=0.02, seed=0)
    error = projective_errors_px(noisy, truth)
    # 0.02 m at 20 m and 1000 px of focal length: 1 px in each coordinate.
    assert np.sqrt(np.mean(error**2) / 2) == pytest.approx(1.0, abs=0.1)


def test_problems_of_different_counts_are_refused() -> None:
    with pytest.raises(InvalidArgument, match="num_cameras"):
        projective_errors_px(sfmcpp.circle_scene(4, 20), sfmcpp.circle_scene(5, 20))
    with pytest.raises(InvalidArgument, match="trusted"):
        projective_errors_px(sfmcpp.circle_scene(4, 20), sfmcpp.circle_scene(4, 20), [True])
