"""Fundamental matrices and homographies from matches, against the truth and against slow references."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from random_scenes import INTRINSICS, Array, project, random_camera, random_pair, spoil
from sfmcpp import InvalidArgument
from sfmcpp.geometry import (
    MatrixEstimate,
    fundamental_from_matches,
    fundamental_linear,
    homography_from_matches,
)
from sfmcpp.geometry.epipolar import fundamental_matrix, sampson_errors_px
from sfmcpp.geometry.two_view_matrices import homography_errors_px

SEEDS = st.integers(0, 2**32 - 1)
NOISE_PX = 0.5
Estimate = Callable[..., MatrixEstimate]


def plane_pair(seed: int, count: int = 200) -> tuple[Array, Array, Array]:
    """Exact pixels of a plane in two images, and the homography between them from its definition."""
    rng = np.random.default_rng(seed)
    camera = random_camera(rng)
    normal, distance = np.array([*rng.uniform(-0.4, 0.4, 2), 1.0]), 8.0
    points = rng.uniform([-4, -3, 0], [4, 3, 0], (count, 3))
    points[:, 2] = (distance - points @ normal) / normal[2]
    images = [project(c, INTRINSICS, points) for c in (np.eye(3, 4), camera)]
    f, aspect, cx, cy, skew = INTRINSICS
    k = np.array([[f, skew, cx], [0, aspect * f, cy], [0, 0, 1]])
    turn, centre = camera[:, :3], camera[:, 3]
    matrix = k @ turn.T @ (np.eye(3) - np.outer(centre, normal) / distance) @ np.linalg.inv(k)
    return images[0], images[1], matrix / np.linalg.norm(matrix)


def up_to_sign(a: Array, b: Array) -> float:
    return float(min(np.linalg.norm(a - b), np.linalg.norm(a + b)))


def noisy(images: tuple[Array, Array], seed: int, outliers: float) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(seed)
    first, second = (pixels + NOISE_PX * rng.standard_normal(pixels.shape) for pixels in images)
    return first, second, np.asarray(~spoil(second, outliers, rng))


@settings(max_examples=10, deadline=None)
@given(seed=SEEDS)
def test_exact_matches_give_the_true_matrices(seed: int) -> None:
    pair = random_pair(seed)
    truth = fundamental_matrix(np.eye(3, 4), pair.camera, INTRINSICS, INTRINSICS)
    truth /= np.linalg.norm(truth)
    assert up_to_sign(fundamental_linear(pair.pixels_1, pair.pixels_2), truth) < 1e-7
    assert up_to_sign(fundamental_from_matches(pair.pixels_1, pair.pixels_2).matrix, truth) < 1e-6
    first, second, homography = plane_pair(seed)
    assert up_to_sign(homography_from_matches(first, second).matrix, homography) < 1e-6


@pytest.mark.parametrize("outliers", [0.0, 0.3, 0.6])
def test_outliers_are_told_apart(outliers: float) -> None:
    for seed in range(5):
        pair = random_pair(seed, 300)
        first, second, good = noisy((pair.pixels_1, pair.pixels_2), seed, outliers)
        found = fundamental_from_matches(first, second)
        assert np.count_nonzero(found.inliers & good) >= 0.98 * np.count_nonzero(good)
        assert np.count_nonzero(found.inliers & ~good) <= 0.03 * len(good)
        plane = plane_pair(seed, 300)
        first, second, good = noisy(plane[:2], seed, outliers)
        found = homography_from_matches(first, second)
        # Of two components of noise 0.04 % are beyond four of its deviations; of outliers few fall so near.
        assert np.count_nonzero(found.inliers & good) >= 0.98 * np.count_nonzero(good)
        assert np.count_nonzero(found.inliers & ~good) <= 0.01 * len(good)


def test_the_fundamental_matrix_has_the_least_sampson_errors_and_rank_two() -> None:
    pair = random_pair(3, 150)
    first, second, _ = noisy((pair.pixels_1, pair.pixels_2), 3, 0.0)
    # A loss of a wide scale is that of least squares.
    found = fundamental_from_matches(first, second, threshold_px=20.0).matrix
    u, d, vt = np.linalg.svd(found)
    assert d[2] < 1e-12

    def errors(x: Array) -> Array:
        turn_u, turn_v = rotation(x[:3]), rotation(x[3:6])
        matrix = (u @ turn_u) * [1.0, np.tan(x[6]) + d[1] / d[0], 0.0] @ turn_v @ vt
        return sampson_errors_px(matrix, first, second)

    best = least_squares(errors, np.zeros(7), x_scale="jac", xtol=1e-15, ftol=1e-15)
    mine = sampson_errors_px(found, first, second)
    assert (mine**2).sum() <= 2 * best.cost * (1 + 1e-4)
    exact = sampson_errors_px(found, pair.pixels_1, pair.pixels_2)
    assert np.sqrt(np.mean(exact**2)) < NOISE_PX * np.sqrt(7 / 150) * 2


def rotation(x: Array) -> Array:
    """Any smooth chart of the rotations near the identity: Cayley's."""
    cross = np.array([[0, -x[2], x[1]], [x[2], 0, -x[0]], [-x[1], x[0], 0]]) / 2
    return np.asarray(np.linalg.solve(np.eye(3) - cross, np.eye(3) + cross))


def test_the_error_of_a_homography_is_to_first_order_the_distance_from_it() -> None:
    first, second, matrix = plane_pair(5, 30)
    rng = np.random.default_rng(5)
    off_1, off_2 = (pixels + 0.1 * rng.standard_normal(pixels.shape) for pixels in (first, second))
    errors = homography_errors_px(matrix, off_1, off_2)

    def image(pixels: Array) -> Array:
        mapped = np.append(pixels, 1.0) @ matrix.T
        return np.asarray(mapped[:2] / mapped[2])

    for k in range(len(first)):
        nearest = least_squares(
            lambda x, k=k: np.concatenate([x - off_1[k], image(x) - off_2[k]]), off_1[k], xtol=1e-12
        )
        assert errors[k] == pytest.approx(np.sqrt(2 * nearest.cost), rel=1e-2)


def test_points_that_a_homography_mirrors_are_infinitely_far() -> None:
    mirror = np.diag([-1.0, 1.0, 1.0])
    beyond = np.array([[1.0, 0, 0], [0, 1.0, 0], [0.01, 0, -1.0]])
    pixels = np.array([[10.0, 20.0], [300.0, 40.0]])
    np.testing.assert_array_equal(np.isinf(homography_errors_px(mirror, pixels, pixels)), [True, True])
    np.testing.assert_array_equal(np.isinf(homography_errors_px(beyond, pixels, pixels)), [False, True])


@pytest.mark.parametrize("estimate", [fundamental_from_matches, homography_from_matches])
@pytest.mark.parametrize("count", [0, 5, 14, 50, 400])
def test_matches_at_random_are_refused(estimate: Estimate, count: int) -> None:
    for seed in range(3):
        pixels = np.random.default_rng(seed).uniform(0, 1000, (2, count, 2))
        found = estimate(*pixels)
        assert not found.success
        assert found.num_inliers == 0
        assert np.isnan(found.matrix).all()
        assert "must be at least" in found.message


@pytest.mark.parametrize("estimate", [fundamental_from_matches, homography_from_matches])
def test_arguments_are_checked(estimate: Estimate) -> None:
    with pytest.raises(InvalidArgument, match="pixels_2"):
        estimate(np.zeros((9, 2)), np.zeros((8, 2)))
    with pytest.raises(InvalidArgument, match="min_inliers = 4"):
        estimate(np.zeros((9, 2)), np.zeros((9, 2)), min_inliers=4)
    with pytest.raises(InvalidArgument, match="confidence = 1"):
        estimate(np.zeros((9, 2)), np.zeros((9, 2)), confidence=1)
