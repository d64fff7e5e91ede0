"""Planes through neighbouring points, and how they are seen: against known surfaces and differences."""

from __future__ import annotations

import numpy as np
import pytest

from sfmcpp.geometry.pinhole import unit
from sfmcpp.geometry.point_tests import projected_points, reprojection_errors_px
from sfmcpp.geometry.surface import surface_normals, surface_slopes
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sources.synthetic.image_geometry import looking_at

RANDOM = np.random.default_rng(5)


def upwards(count: int) -> FloatArray:
    return np.tile([0.0, 0.0, 1.0], (count, 1))


def test_normals_of_a_sphere_are_its_radii_on_the_side_of_who_looks() -> None:
    radii = unit(RANDOM.normal(size=(4000, 3)))
    radii = radii[radii[:, 2] > 0.6]
    normals = surface_normals(5.0 * radii, upwards(len(radii)))
    angles = np.degrees(np.arccos((normals * radii).sum(axis=1).clip(-1, 1)))
    assert np.median(angles) < 3
    inside = surface_normals(5.0 * radii, -upwards(len(radii)))
    np.testing.assert_allclose(inside, -normals)


def test_points_without_a_plane_face_who_looks() -> None:
    cloud, few = RANDOM.normal(size=(500, 3)), RANDOM.normal(size=(5, 3))
    assert np.mean((surface_normals(cloud, upwards(500)) == upwards(500)).all(axis=1)) > 0.6
    np.testing.assert_array_equal(surface_normals(few, upwards(5)), upwards(5))
    wall = cloud * [0.0, 1.0, 1.0]
    np.testing.assert_array_equal(surface_normals(wall, upwards(500)), upwards(500))


@pytest.mark.parametrize("model", ["calibrated", "perspective"])
def test_slopes_are_those_of_the_images_of_points_that_move_on_the_surface(model: str) -> None:
    centres = RANDOM.normal(size=(3, 3)) - np.array([0.0, 6.0, 0.0])
    poses = looking_at(centres, np.zeros((3, 3)), np.array([0.0, 0.0, 1.0]))
    row = [500.0, 1.02, 320.0, 240.0, 0.3, -0.1, 0.05, 0.0, 0.0, 0.0, 1e-3, -2e-3]
    points, normals = RANDOM.normal(size=(20, 3)), unit(RANDOM.normal(size=(20, 3)))
    seen = np.indices((3, 20)).reshape(2, -1).astype(np.int32)
    intrinsics = np.array([row if model == "perspective" else row[:5]])
    shared = np.zeros(3, dtype=np.int32)
    problem = Problem(model, poses, intrinsics, points, *seen, np.zeros((60, 2)), intrinsics_index=shared)
    slopes = surface_slopes(problem, normals)
    # Coordinates on the surface are not told, so they come from one image, and tell the others.
    step = 1e-6 * np.cross(normals, RANDOM.normal(size=(20, 3)))
    moved = projected_points(problem, points + step) - projected_points(problem, points - step)
    moved = moved.reshape(3, 20, 2) / 2
    slopes = slopes.reshape(3, 20, 2, 2)
    on_surface = np.linalg.solve(slopes[0], moved[0][:, :, None])
    np.testing.assert_allclose(
        np.linalg.norm(on_surface[:, :, 0], axis=1), np.linalg.norm(step, axis=1), rtol=1e-5
    )
    for image in (1, 2):
        np.testing.assert_allclose((slopes[image] @ on_surface)[:, :, 0], moved[image], rtol=1e-4, atol=1e-9)


def test_projected_points_are_where_the_errors_vanish_and_nowhere_behind_a_camera() -> None:
    pose = np.eye(3, 4)[None]
    points = np.array([[0.1, 0.2, 3.0], [0.1, 0.2, -3.0], [np.nan, 0.0, 1.0]])
    seen = np.zeros(3, dtype=np.int32), np.arange(3, dtype=np.int32)
    problem = Problem("bal", pose, np.array([[400.0, -0.1, 0.02]]), points, *seen, np.zeros((3, 2)))
    problem.pixels[:] = projected_points(problem, points)
    assert np.isnan(problem.pixels[1:]).all()
    problem.pixels[1:] = 0.0
    np.testing.assert_allclose(reprojection_errors_px(problem, points), [0.0, np.inf, np.inf], atol=1e-12)
