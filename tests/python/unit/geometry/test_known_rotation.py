"""Poses of a camera of known rotation: exact on exact data, and in spite of outliers."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sfmcpp import InvalidArgument
from sfmcpp.geometry import relative_pose_of_rotation, resection_of_rotation
from sfmcpp.geometry.pinhole import to_pixels

INTRINSICS = np.array([700.0, 1.0, 600.0, 180.0, 0.0])
ROTATION = Rotation.from_rotvec([0.02, -0.05, 0.01]).as_matrix()
CENTRE = np.array([0.1, -0.05, 1.2])


def seen(points: np.ndarray, rotation: np.ndarray, centre: np.ndarray) -> np.ndarray:
    x, y, z = rotation.T @ (points - centre).T
    return np.asarray(to_pixels(np.column_stack([x / z, y / z]), INTRINSICS))


def scene(count: int, wrong: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, and their pixels in both cameras; a share `wrong` of the second ones anywhere."""
    rng = np.random.default_rng(seed)
    points = rng.uniform([-6, -2, 5], [6, 2, 40], (count, 3))
    first, second = seen(points, np.eye(3), np.zeros(3)), seen(points, ROTATION, CENTRE)
    second[: int(wrong * count)] += rng.uniform(20, 80, (int(wrong * count), 2))
    return points, first, second


@pytest.mark.parametrize("wrong", [0.0, 0.5])
def test_the_direction_of_the_motion_is_found(wrong: float) -> None:
    _, first, second = scene(80, wrong, seed=1)
    found = relative_pose_of_rotation(first, second, INTRINSICS, ROTATION)
    assert found.success
    # Some wrong matches are near their epipolar lines by chance, and pull.
    expected = CENTRE / np.linalg.norm(CENTRE)
    np.testing.assert_allclose(found.camera[:, 3], expected, atol=1e-2 * (wrong > 0) + 1e-9)


@pytest.mark.parametrize("wrong", [0.0, 0.5])
def test_the_centre_is_found(wrong: float) -> None:
    points, _, second = scene(60, wrong, seed=2)
    found = resection_of_rotation(points, second, INTRINSICS, ROTATION)
    assert found.num_inliers == 60 - int(60 * wrong)
    np.testing.assert_allclose(found.camera[:, 3], CENTRE, atol=2e-2 * (wrong > 0) + 1e-9)


@pytest.mark.parametrize("unit", [1e-6, 1e6])
def test_the_centre_does_not_depend_on_the_unit_of_length(unit: float) -> None:
    points, _, second = scene(60, 0.0, seed=2)
    found = resection_of_rotation(unit * points, second, INTRINSICS, ROTATION)
    assert found.num_inliers == 60
    np.testing.assert_allclose(found.camera[:, 3] / unit, CENTRE, atol=1e-9)


def test_the_centre_is_found_far_from_the_origin_of_the_world() -> None:
    points, _, second = scene(60, 0.0, seed=2)
    origin = np.array([4e5, 5.3e6, 200.0])
    found = resection_of_rotation(points + origin, second, INTRINSICS, ROTATION)
    np.testing.assert_allclose(found.camera[:, 3] - origin, CENTRE, atol=1e-6)


def test_a_wrong_rotation_loses_inliers() -> None:
    points, first, second = scene(80, 0.0, seed=3)
    turned = ROTATION @ Rotation.from_rotvec([0.0, 0.0, 0.06]).as_matrix()
    assert relative_pose_of_rotation(first, second, INTRINSICS, turned, min_inliers=2).num_inliers < 40
    assert resection_of_rotation(points, second, INTRINSICS, turned, min_inliers=2).num_inliers < 40


def test_too_few_are_refused() -> None:
    points, first, second = scene(8, 0.0, seed=4)
    assert relative_pose_of_rotation(first, second, INTRINSICS, ROTATION).failure == "too few matches"
    assert resection_of_rotation(points, second, INTRINSICS, ROTATION).failure == "too few matches"


@pytest.mark.parametrize("matrix", [2 * np.eye(3), np.diag([1.0, 1.0, -1.0])])
def test_a_matrix_that_is_no_rotation_is_refused(matrix: np.ndarray) -> None:
    points, first, second = scene(60, 0.0, seed=1)
    with pytest.raises(InvalidArgument, match="rotation: must be orthonormal and right-handed"):
        relative_pose_of_rotation(first, second, INTRINSICS, matrix)
    with pytest.raises(InvalidArgument, match="rotation: must be orthonormal and right-handed"):
        resection_of_rotation(points, second, INTRINSICS, matrix)
