"""Pose and focal length of a camera from points it sees, against the truth."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from random_scenes import Array, angle_deg, project, random_camera, spoil
from sfmcpp import InvalidArgument
from sfmcpp.geometry import FocalPoseEstimate, resection, resection_with_focal

NOISE_PX = 0.5


class View:
    """A camera of unknown focal length, points and noisy images of them, some far off."""

    def __init__(self, seed: int, count: int = 200, outliers: float = 0.0, plane: str = "") -> None:
        rng = np.random.default_rng(seed)
        self.camera = random_camera(rng)
        self.points = rng.uniform([-4, -3, 4], [4, 3, 12], (count, 3))
        if plane == "slanted":
            self.points[:, 2] = 8 + 0.5 * self.points[:, 0]
        if plane == "facing":
            self.points[:, 2], self.camera[:, :3] = 8, np.eye(3)
        self.row = np.array([rng.uniform(500, 2000), 1.1, 310.0, 250.0, 0.0])
        self.pixels = project(self.camera, self.row, self.points)
        self.pixels += NOISE_PX * rng.standard_normal((count, 2))
        self.good = ~spoil(self.pixels, outliers, rng)

    def guess(self, factor: float) -> Array:
        return np.array([factor * self.row[0], *self.row[1:]])

    def found(self, factor: float = 1.5, **options: Any) -> FocalPoseEstimate:
        return resection_with_focal(self.points, self.pixels, self.guess(factor), **options)


@pytest.mark.parametrize("outliers", [0.0, 0.3, 0.6])
@pytest.mark.parametrize("plane", ["", "slanted"])
@pytest.mark.parametrize("factor", [0.6, 1.0, 2.0])
def test_pose_and_focal_length_are_found_in_spite_of_outliers(
    outliers: float, plane: str, factor: float
) -> None:
    for seed in range(3):
        view = View(seed, outliers=outliers, plane=plane)
        found = view.found(factor)
        assert found.success
        # Within four of the standard deviations it states, which are small.
        assert abs(found.focal_px - view.row[0]) < 4 * found.focal_sigma_px
        assert found.focal_sigma_px < 0.01 * view.row[0]
        assert angle_deg(found.camera[:, :3], view.camera[:, :3]) < 0.3
        assert np.count_nonzero(found.inliers & view.good) >= 0.99 * np.count_nonzero(view.good)
        assert np.count_nonzero(found.inliers & ~view.good) <= 0.02 * len(view.good)


def test_without_outliers_it_is_the_least_squares_solution() -> None:
    view = View(7)
    found = view.found(threshold_px=1000.0)

    def residuals(x: Array) -> Array:
        camera = np.column_stack([Rotation.from_rotvec(x[:3]).as_matrix(), x[3:6]])
        return (project(camera, np.array([x[6], *view.row[1:]]), view.points) - view.pixels).ravel()

    turn = Rotation.from_matrix(view.camera[:, :3]).as_rotvec()
    start = np.concatenate([turn, view.camera[:, 3], [view.row[0]]])
    # Square pixels are what is minimised: the rows of the aspect ratio count by its inverse.
    best = least_squares(lambda x: residuals(x) / np.tile([1, view.row[1]], len(view.points)), start).x
    assert abs(found.focal_px - best[6]) < 1e-2 * found.focal_sigma_px
    np.testing.assert_allclose(found.camera[:, 3], best[3:6], atol=1e-4)


def test_the_stated_deviation_is_that_of_many_noises() -> None:
    found = [View(seed, count=60).found(1.0) for seed in range(40)]
    off = [(f.focal_px - View(seed, count=60).row[0]) / f.focal_sigma_px for seed, f in enumerate(found)]
    assert 0.7 < np.std(off) < 1.4


def test_a_plane_that_faces_the_camera_leaves_the_focal_length_open() -> None:
    found = View(1, plane="facing").found()
    assert found.failure == "open focal length"
    assert np.isnan(found.focal_px)


def test_a_world_far_from_its_origin_changes_nothing() -> None:
    view = View(2, outliers=0.3)
    near = view.found()
    view.points += [4e5, 5e6, 100]
    far = view.found()
    np.testing.assert_array_equal(far.inliers, near.inliers)
    assert abs(far.focal_px - near.focal_px) < 0.05 * near.focal_sigma_px


@pytest.mark.parametrize("unit", [1e-8, 1e7])
def test_the_unit_of_length_changes_nothing(unit: float) -> None:
    view = View(4)
    here = view.found()
    view.points *= unit
    there = view.found()
    assert there.focal_px == pytest.approx(here.focal_px, rel=1e-7)
    np.testing.assert_allclose(there.camera[:, 3] / unit, here.camera[:, 3], atol=1e-5)


def test_failures_are_named() -> None:
    view = View(3, count=120, outliers=1.0)
    assert view.found().failure == "too few inliers"
    few = resection_with_focal(view.points[:9], view.pixels[:9], view.row)
    assert few.failure == "too few matches"
    line = np.outer(np.arange(120.0), [1.0, 2, 3])
    assert resection_with_focal(line, view.pixels, view.row).failure == "collinear points"
    with pytest.raises(InvalidArgument, match="max_focal_sigma = 0"):
        view.found(max_focal_sigma=0)


def test_the_seed_decides() -> None:
    view = View(4, outliers=0.5)
    first, second = view.found(seed=3), view.found(seed=3)
    np.testing.assert_array_equal(first.camera, second.camera)
    assert first.focal_px == second.focal_px


def test_with_known_focal_length_and_most_matches_wrong_the_pose_is_that_of_the_good_ones() -> None:
    for seed in range(5):
        view = View(seed, count=300, outliers=0.6)
        found = resection(view.points, view.pixels, view.row)
        assert np.count_nonzero(found.inliers & view.good) >= 0.99 * np.count_nonzero(view.good)
        known = view.points[view.good], view.pixels[view.good]

        def residuals(x: Array, view: View = view, known: tuple[Array, Array] = known) -> Array:
            camera = np.column_stack([Rotation.from_rotvec(x[:3]).as_matrix(), x[3:]])
            return (project(camera, view.row, known[0]) - known[1]).ravel()

        start = np.append(Rotation.from_matrix(view.camera[:, :3]).as_rotvec(), view.camera[:, 3])
        best = least_squares(residuals, start).x
        # A robust loss of 3 px differs from the squares of 0.5 px by a little.
        assert np.linalg.norm(found.camera[:, 3] - best[3:]) < 3e-3
