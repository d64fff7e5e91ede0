"""Points on one line, with the noise and the outliers of real ones, leave a pose open; this is named."""

from __future__ import annotations

import numpy as np
import pytest

from random_scenes import INTRINSICS, Array, angle_deg, project, random_camera
from sfmcpp.geometry import relative_pose, resection, resection_with_focal, two_view_geometry

LINE = np.linspace([-2.5, -1.5, 6.0], [2.0, 1.5, 9.0], 60)
SEEDS = range(6)


def scene(seed: int, points: Array) -> tuple[np.random.Generator, Array, Array]:
    """A generator, a camera, and its noisy images of the points."""
    rng = np.random.default_rng(seed)
    camera = random_camera(rng)
    camera[:, 3] = [2.0, -0.5, 0.5]
    return rng, camera, project(camera, INTRINSICS, points) + rng.normal(0, 0.4, (len(points), 2))


@pytest.mark.parametrize("estimate", [resection, resection_with_focal])
@pytest.mark.parametrize("seed", SEEDS)
def test_points_beside_a_line_by_their_noise_are_collinear(estimate, seed: int) -> None:  # type: ignore[no-untyped-def]
    rng, _, pixels = scene(seed, LINE)
    found = estimate(LINE + rng.normal(0, 1e-4, LINE.shape), pixels, INTRINSICS)
    assert found.failure in ("collinear points", "open focal length")
    assert np.isnan(found.camera).all()


@pytest.mark.parametrize("estimate", [resection, resection_with_focal])
@pytest.mark.parametrize("seed", SEEDS)
def test_an_outlier_that_a_turn_round_the_line_meets_is_no_proof(estimate, seed: int) -> None:  # type: ignore[no-untyped-def]
    rng, _, pixels = scene(seed, LINE)
    points = LINE.copy()
    points[::4] = rng.uniform([-4, -3, 4], [4, 3, 12], (15, 3))
    found = estimate(points, pixels, INTRINSICS)
    assert found.failure in ("collinear points", "open focal length")


@pytest.mark.parametrize("seed", SEEDS)
def test_two_points_beside_the_line_hold_the_camera(seed: int) -> None:
    points = LINE.copy()
    points[[10, 50]] += [[1.5, -1.0, 0.0], [-1.0, 2.0, 0.5]]
    _, camera, pixels = scene(seed, points)
    found = resection(points, pixels, INTRINSICS)
    assert found.success
    assert angle_deg(found.camera[:, :3], camera[:, :3]) < 2.0


@pytest.mark.parametrize("seed", SEEDS)
def test_matches_on_a_line_leave_the_relative_pose_open(seed: int) -> None:
    rng, _, second = scene(seed, LINE)
    first = project(np.eye(3, 4), INTRINSICS, LINE) + rng.normal(0, 0.4, second.shape)
    found = relative_pose(first, second, INTRINSICS)
    assert found.failure == "collinear matches"
    assert np.isnan(found.camera).all()
    pair = two_view_geometry(first, second, INTRINSICS, INTRINSICS)
    assert pair.kind == "planar"
    assert np.isnan(pair.camera).all()
    assert "on one line" in pair.message


@pytest.mark.parametrize("seed", SEEDS)
def test_a_quarter_of_matches_beside_the_line_gives_the_relative_pose(seed: int) -> None:
    points = LINE.copy()
    points[::4] = np.random.default_rng(seed).uniform([-3, -2, 5], [3, 2, 10], (15, 3))
    rng, camera, second = scene(seed, points)
    first = project(np.eye(3, 4), INTRINSICS, points) + rng.normal(0, 0.4, second.shape)
    found = relative_pose(first, second, INTRINSICS)
    assert found.success
    assert angle_deg(found.camera[:, :3], camera[:, :3]) < 2.0
