"""Image points, epipolar geometry, nearest points of rays and cheirality of two cameras, by definition."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from random_scenes import INTRINSICS, calibration, project, random_camera, random_pair
from sfmcpp.geometry.epipolar import (
    closest_depths,
    fundamental_matrix,
    in_front_of_both,
    midpoints,
    sampson_errors_px,
)
from sfmcpp.geometry.pinhole import inverse_calibration, to_normalised, to_pixels

OTHER = np.array([450.0, 0.9, 200.0, 150.0, -3.0])
SEEDS = st.integers(0, 2**32 - 1)


@settings(max_examples=20, deadline=None)
@given(SEEDS)
def test_normalising_undoes_the_calibration_matrix(seed: int) -> None:
    points = np.random.default_rng(seed).uniform(-2, 2, (30, 2))
    homogeneous = np.column_stack([points, np.ones(30)]) @ calibration(INTRINSICS).T
    np.testing.assert_allclose(to_pixels(points, INTRINSICS), homogeneous[:, :2], atol=1e-9)
    np.testing.assert_allclose(to_normalised(homogeneous[:, :2], INTRINSICS), points, atol=1e-12)
    np.testing.assert_allclose(
        inverse_calibration(INTRINSICS) @ calibration(INTRINSICS), np.eye(3), atol=1e-12
    )


@settings(max_examples=20, deadline=None)
@given(SEEDS)
def test_images_of_one_point_satisfy_the_fundamental_matrix(seed: int) -> None:
    rng = np.random.default_rng(seed)
    first, second = random_camera(rng, 3.0, 2.0), random_camera(rng, 1.0, 2.0)
    points = rng.standard_normal((30, 3))
    f = fundamental_matrix(first, second, INTRINSICS, OTHER)
    images = project(first, INTRINSICS, points), project(second, OTHER, points)
    a, b = (np.column_stack([x, np.ones(30)]) for x in images)
    a, b = (x / np.linalg.norm(x, axis=1, keepdims=True) for x in (a, b))
    np.testing.assert_allclose(np.einsum("ni,ij,nj->n", a, f / np.linalg.norm(f), b), 0.0, atol=1e-12)
    assert np.linalg.svd(f, compute_uv=False)[1] > 0


def test_many_pairs_give_what_each_gives_alone() -> None:
    rng = np.random.default_rng(1)
    first, second = (np.stack([random_camera(rng) for _ in range(4)]) for _ in range(2))
    rows = np.stack([INTRINSICS, OTHER, INTRINSICS, OTHER])
    together = fundamental_matrix(first, second, rows, rows[::-1])
    alone = [fundamental_matrix(*pair) for pair in zip(first, second, rows, rows[::-1], strict=True)]
    np.testing.assert_allclose(together, alone, rtol=1e-12)


def test_small_errors_are_the_distance_to_the_nearest_exact_match() -> None:
    pair, rng = random_pair(2), np.random.default_rng(2)
    f = fundamental_matrix(np.eye(3, 4), pair.camera, INTRINSICS, INTRINSICS)
    line_1 = np.column_stack([pair.pixels_2, np.ones(200)]) @ f.T
    line_2 = np.column_stack([pair.pixels_1, np.ones(200)]) @ f
    normal = np.hstack([line_1[:, :2], line_2[:, :2]])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    distance = 1e-3 * rng.standard_normal(200)
    moved = np.hstack([pair.pixels_1, pair.pixels_2]) + distance[:, None] * normal
    np.testing.assert_allclose(sampson_errors_px(f, moved[:, :2], moved[:, 2:]), np.abs(distance), atol=1e-7)


def test_a_point_is_in_front_of_both_cameras_only_where_both_depths_are_positive() -> None:
    rng = np.random.default_rng(3)
    first, second = random_camera(rng, 2.0, 3.0), random_camera(rng, 2.0, 3.0)
    points = rng.uniform(-6, 6, (2000, 3))
    depth_1, depth_2 = (((points - c[:, 3]) @ c[:, :3])[:, 2] for c in (first, second))
    unit_intrinsics = np.array([1.0, 1, 0, 0, 0])
    images = (project(c, unit_intrinsics, points) for c in (first, second))
    assert min(np.bincount(2 * (depth_1 > 0) + (depth_2 > 0))) > 20
    np.testing.assert_array_equal(in_front_of_both(first, second, *images), (depth_1 > 0) & (depth_2 > 0))


@pytest.mark.parametrize("seed", range(5))
def test_depths_and_midpoints_are_the_least_squares_of_the_distance(seed: int) -> None:
    random = np.random.default_rng(seed)
    rays, centres = random.normal(size=(2, 7, 3)), random.normal(size=(2, 7, 3))
    depth_1, depth_2, factor = closest_depths(rays[0], rays[1], centres[1] - centres[0])
    middle = midpoints(rays[0], centres[0], rays[1], centres[1])
    for k in range(7):
        base = centres[1, k] - centres[0, k]
        expected = np.linalg.lstsq(np.column_stack([rays[0, k], -rays[1, k]]), base, rcond=None)[0]
        assert np.array([depth_1[k], depth_2[k]]) / factor[k] == pytest.approx(expected, rel=1e-9)
        ends = [c + d * r for c, d, r in zip(centres[:, k], expected, rays[:, k], strict=True)]
        assert middle[k] == pytest.approx(np.mean(ends, axis=0), rel=1e-9)


def test_parallel_lines_have_no_middle() -> None:
    ray = np.array([[0.0, 0.0, 1.0]])
    _, _, factor = closest_depths(ray, 2 * ray, np.array([[1.0, 0.0, 0.0]]))
    assert factor == [0.0]
    assert not np.isfinite(midpoints(ray, np.zeros((1, 3)), ray, np.array([[1.0, 0, 0]]))).any()
