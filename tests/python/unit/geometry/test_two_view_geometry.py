"""Two-view geometry: which model is taken, and how near it comes to the truth."""

from __future__ import annotations

import numpy as np
import pytest

from mvg_helpers import INTRINSICS, Array, Pair, calibration, project, random_camera, spoil
from sfmcpp.geometry import TwoViewGeometry, two_view_geometry

KNOWN = (INTRINSICS, INTRINSICS)
NOISE_PX = 0.5


def pair_of(kind: str, seed: int, count: int = 400) -> Pair:
    """A scene in depth, a plane, or a turn on the spot, without noise."""
    rng = np.random.default_rng(seed)
    camera = random_camera(rng)
    points = rng.uniform([-4, -3, 4], [4, 3, 12], (count, 3))
    if kind == "planar":
        a, b = rng.uniform(-0.4, 0.4, 2)
        points[:, 2] = 8 + a * points[:, 0] + b * points[:, 1]
    if kind == "rotation":
        camera[:, 3] = 0
    images = [project(c, INTRINSICS, points) for c in (np.eye(3, 4), camera)]
    return Pair(camera, points, images[0], images[1])


def with_noise_and_outliers(pair: Pair, seed: int, outliers: float) -> Array:
    """Spoil the pixels of both images, in place; which matches are still good."""
    rng = np.random.default_rng(seed)
    for pixels in (pair.pixels_1, pair.pixels_2):
        pixels += NOISE_PX * rng.standard_normal(pixels.shape)
    return np.asarray(~spoil(pair.pixels_2, outliers, rng))


def estimated(pair: Pair, known: bool) -> TwoViewGeometry:
    return two_view_geometry(pair.pixels_1, pair.pixels_2, *(KNOWN if known else ()))


def true_fundamental(pair: Pair) -> Array:
    """From the definition: K₁⁻ᵀ [c]× R K₂⁻¹."""
    x, y, z = pair.camera[:, 3]
    inverse = np.linalg.inv(calibration(INTRINSICS))
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrix = inverse.T @ cross @ pair.camera[:, :3] @ inverse
    return np.asarray(matrix / np.linalg.norm(matrix))


def distances_from_epipolar_lines_px(fundamental: Array, pair: Pair) -> Array:
    """In the first image, of exact matches."""
    ones = np.ones((len(pair.points), 1))
    lines = np.hstack([project(pair.camera, INTRINSICS, pair.points), ones]) @ fundamental.T
    exact = np.hstack([project(np.eye(3, 4), INTRINSICS, pair.points), ones])
    return np.asarray(abs((lines * exact).sum(1)) / np.linalg.norm(lines[:, :2], axis=1))


@pytest.mark.parametrize("outliers", [0.0, 0.2, 0.5])
@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("kind", ["general", "planar", "rotation"])
def test_the_model_is_that_of_the_scene(kind: str, known: bool, outliers: float) -> None:
    for seed in range(5):
        pair = pair_of(kind, seed)
        good = with_noise_and_outliers(pair, seed, outliers)
        geometry = estimated(pair, known)
        # Without the focal length a turn is one of the homographies that a plane could have.
        assert geometry.kind == ("planar" if kind == "rotation" and not known else kind)
        assert np.count_nonzero(geometry.inliers & good) >= 0.97 * np.count_nonzero(good)
        assert np.count_nonzero(geometry.inliers & ~good) <= 0.02 * len(good)
        assert (geometry.message == "") == (kind == "general")


@pytest.mark.parametrize("known", [True, False])
def test_the_fundamental_matrix_leads_exact_matches_to_their_lines(known: bool) -> None:
    for seed in range(5):
        pair = pair_of("general", seed)
        with_noise_and_outliers(pair, seed, 0.3)
        fundamental = estimated(pair, known).fundamental
        # 280 matches with 0.5 px determine 7 numbers: the lines move by a small part of the noise.
        assert np.median(distances_from_epipolar_lines_px(fundamental, pair)) < NOISE_PX / 4
        assert abs(np.linalg.det(fundamental)) < 1e-12
