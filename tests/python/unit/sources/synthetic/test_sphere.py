"""Cameras evenly on the sphere, points evenly in the ball."""

from __future__ import annotations

import numpy as np

from sfmcpp.sources.synthetic import sphere_scene


def test_cameras_stand_on_the_sphere_and_look_at_its_centre() -> None:
    problem = sphere_scene(40, 10, radius_m=8.0)
    np.testing.assert_allclose(np.linalg.norm(problem.centres, axis=1), 8.0)
    np.testing.assert_allclose(problem.rotations[:, :, 2], -problem.centres / 8.0, atol=1e-15)


def test_cameras_are_spread_evenly() -> None:
    centres = sphere_scene(200, 10, radius_m=1.0).centres
    distances = np.linalg.norm(centres[:, None] - centres[None], axis=2)
    np.fill_diagonal(distances, np.inf)
    nearest = distances.min(axis=1)
    # Each camera has 4π/200 of the sphere; the best packing has neighbours at 1.0746 √area.
    spacing = 1.0746 * np.sqrt(4 * np.pi / 200)
    assert 0.7 * spacing < nearest.min()
    assert nearest.max() < 1.0 * spacing
    np.testing.assert_allclose(centres.mean(axis=0), 0.0, atol=0.005)


def test_points_fill_the_ball_uniformly() -> None:
    points = sphere_scene(2, 8000, ball_m=3.0, seed=5).points
    radius = np.linalg.norm(points, axis=1)
    assert radius.max() <= 3.0
    # The share of the volume within each point's radius is uniform: mean 1/2, deviation 1/√12.
    within = (radius / 3.0) ** 3
    np.testing.assert_allclose([within.mean(), within.std()], [0.5, 1 / np.sqrt(12)], rtol=0.03)
    np.testing.assert_allclose(points.mean(axis=0), 0.0, atol=0.06)


def test_the_ball_is_seen_whole_by_every_camera() -> None:
    problem = sphere_scene()
    assert problem.num_observations == 50 * 500
