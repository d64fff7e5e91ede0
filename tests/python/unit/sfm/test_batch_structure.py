"""Points and single cameras of a projective world, against scenes of known cameras."""

from __future__ import annotations

import numpy as np

import sfmcpp
from batch_scenes import measured_of, random_homography, true_cameras, turntable
from sfmcpp.sfm.batch.direct_linear import (
    reprojection_errors_px,
    resect,
    triangulate,
    triangulate_without_outliers,
)


def test_exact_observations_give_exact_points_in_any_frame() -> None:
    scene = turntable(6, 40)
    measured = measured_of(scene)
    cameras = true_cameras(scene, measured) @ random_homography()
    points = triangulate(measured, cameras, np.arange(len(measured.image)))
    back = points @ random_homography().T
    np.testing.assert_allclose(back[:, :3] / back[:, 3:], scene.points, atol=1e-7)


def test_a_track_of_one_image_has_no_point() -> None:
    scene = turntable(4, 20)
    measured = measured_of(scene)
    rows = np.flatnonzero((measured.track != 3) | (measured.image == 0))
    points = triangulate(measured, true_cameras(scene, measured), rows)
    assert np.isnan(points[3]).all()
    assert np.isfinite(np.delete(points, 3, axis=0)).all()


def test_wrong_observations_are_left_out_and_right_ones_kept() -> None:
    scene = turntable(10, 100, sigma_px=0.5)
    seen, is_wrong = sfmcpp.add_outliers(scene, 0.05, seed=1)
    measured = measured_of(seen)
    cameras = true_cameras(scene, measured)
    _, kept = triangulate_without_outliers(measured, cameras, np.ones(len(is_wrong), np.bool_), 3.0, rounds=8)
    wrong = is_wrong[np.lexsort((seen.point_index, seen.camera_index))]
    assert kept[~wrong].mean() > 0.98
    assert kept[wrong].mean() < 0.02


def test_what_is_behind_a_camera_is_no_projection() -> None:
    scene = turntable(4, 20)
    measured = measured_of(scene)
    cameras = true_cameras(scene, measured)
    points = np.c_[scene.points, np.ones(20)]
    assert reprojection_errors_px(measured, cameras, points).max() < 1e-9
    points[5] *= -1
    error = reprojection_errors_px(measured, cameras, points)
    assert np.isinf(error[measured.track == 5]).all()
    assert np.isfinite(error[measured.track != 5]).all()


def test_a_camera_is_found_among_wrong_matches() -> None:
    scene = turntable(4, 80, sigma_px=0.3)
    measured = measured_of(scene)
    frame = random_homography()
    points = np.c_[scene.points, np.ones(80)] @ np.linalg.inv(frame).T
    rows = measured.rows_of(1)
    rays = measured.rays[rows].copy()
    rng = np.random.default_rng(0)
    wrong = rng.permutation(len(rows))[: len(rows) // 2]
    rays[wrong, :2] = rng.uniform(-2, 2, (len(wrong), 2))
    camera, inliers = resect(rays, points[measured.track[rows]], 3.0 / measured.frames[1, 0], seed=0)
    right = np.setdiff1d(np.arange(len(rows)), wrong)
    assert inliers[right].all()
    assert inliers[wrong].mean() < 0.05
    expected = true_cameras(scene, measured)[1] @ frame
    expected /= np.linalg.norm(expected)
    np.testing.assert_allclose(camera / np.linalg.norm(camera), expected, atol=0.02)
