"""Two-view geometry: which model is taken, and how near it comes to the truth."""

from __future__ import annotations

import numpy as np
import pytest

from random_scenes import INTRINSICS, Array, Pair, angle_deg, calibration, project, random_camera, spoil
from sfmcpp import InvalidArgument
from sfmcpp.geometry import TwoViewGeometry, two_view_geometry
from sfmcpp.geometry.pinhole import to_normalised, to_pixels

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


@pytest.mark.parametrize("outliers", [0.0, 0.4])
def test_the_pose_of_known_cameras_is_that_of_the_scene(outliers: float) -> None:
    turns, directions = [], []
    for seed in range(20):
        pair = pair_of("general", seed)
        with_noise_and_outliers(pair, seed, outliers)
        geometry = estimated(pair, known=True)
        turns.append(angle_deg(geometry.camera[:, :3], pair.camera[:, :3]))
        directions.append(angle_deg(geometry.camera[:, 3], pair.camera[:, 3]))
        assert np.linalg.norm(geometry.camera[:, 3]) == pytest.approx(1.0)
        truth = true_fundamental(pair)
        assert min(np.linalg.norm(geometry.fundamental - s * truth) for s in (1, -1)) < 0.02
        rays = pair.points / np.linalg.norm(pair.points, axis=1, keepdims=True)
        others = pair.points - pair.camera[:, 3]
        cosines = (rays * others).sum(axis=1) / np.linalg.norm(others, axis=1)
        # The outliers are the median of another set of points.
        assert geometry.median_angle_deg == pytest.approx(np.degrees(np.median(np.arccos(cosines))), rel=0.15)
    # One pixel is 0.08°: 240 matches and more average 0.5 px to a part of it, less so along the baseline.
    assert np.median(turns) < 0.04
    assert max(turns) < 0.2
    assert np.median(directions) < 0.3
    assert max(directions) < 2.0


def test_the_pose_of_a_plane_is_one_of_the_two_it_allows() -> None:
    for seed in range(10):
        pair = pair_of("planar", seed)
        with_noise_and_outliers(pair, seed, 0.2)
        geometry = estimated(pair, known=True)
        near = angle_deg(geometry.camera[:, :3], pair.camera[:, :3]) < 1.0
        # Where the other pose is taken it is said that there are two.
        assert near or "another pose" in geometry.message
        assert "plane" in geometry.message


def test_a_turn_has_its_rotation_and_no_translation() -> None:
    for seed in range(10):
        pair = pair_of("rotation", seed)
        with_noise_and_outliers(pair, seed, 0.3)
        geometry = estimated(pair, known=True)
        assert angle_deg(geometry.camera[:, :3], pair.camera[:, :3]) < 0.05
        np.testing.assert_array_equal(geometry.camera[:, 3], 0)
        assert np.isnan(geometry.fundamental).all()
        assert geometry.median_angle_deg < 0.1


@pytest.mark.parametrize("known", [True, False])
def test_the_same_photo_twice_is_named(known: bool) -> None:
    pair = pair_of("general", 0)
    pair.pixels_2[:] = pair.pixels_1
    spoil(pair.pixels_2, 0.1, np.random.default_rng(0))
    geometry = estimated(pair, known)
    assert geometry.kind == "rotation"
    assert "identical" in geometry.message
    assert np.count_nonzero(geometry.inliers) == 360
    assert np.isfinite(geometry.camera).all() == known


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("count", [0, 3, 14, 40, 300])
def test_matches_at_random_give_nothing(count: int, known: bool) -> None:
    for seed in range(3):
        rng = np.random.default_rng(seed)
        pixels = rng.uniform([0, 0], [700, 500], (2, count, 2))
        geometry = two_view_geometry(*pixels, *(KNOWN if known else ()))
        assert geometry.kind == "none"
        assert geometry.inliers.shape == (count,)
        assert not geometry.inliers.any()
        assert "must be at least" in geometry.message


def test_points_that_coincide_give_nothing() -> None:
    pixels = np.tile([[300.0, 200.0]], (50, 1))
    for known in ((), KNOWN):
        assert two_view_geometry(pixels, pixels + 100, *known).kind == "none"


def test_a_plane_before_a_backdrop_is_general_and_one_with_few_points_off_is_not() -> None:
    for share, kind in ((0.3, "general"), (0.02, "planar")):
        pair = pair_of("planar", 3)
        off = np.arange(len(pair.points)) < share * len(pair.points)
        pair.points[off, 2] *= 0.5
        pixels = [project(c, INTRINSICS, pair.points) for c in (np.eye(3, 4), pair.camera)]
        for known in ((), KNOWN):
            assert two_view_geometry(*pixels, *known).kind == kind


def test_a_poor_guess_of_the_focal_length_keeps_the_matches_and_says_so() -> None:
    pair = pair_of("general", 1)
    good = with_noise_and_outliers(pair, 1, 0.2)
    guess = INTRINSICS * [2.5, 1, 1, 1, 1]
    geometry = two_view_geometry(pair.pixels_1, pair.pixels_2, guess, guess)
    assert geometry.kind == "general"
    assert np.count_nonzero(geometry.inliers & good) >= 0.97 * np.count_nonzero(good)
    assert np.median(distances_from_epipolar_lines_px(geometry.fundamental, pair)) < NOISE_PX
    assert np.isnan(geometry.camera).all() or "far off" in geometry.message


def test_distortion_is_taken_out_of_the_pixels() -> None:
    pair = pair_of("general", 2)
    lens = np.concatenate([INTRINSICS, [-0.25, 0.05, 0, 0, 0, 1e-3, -2e-3]])
    seen = [to_pixels(to_normalised(pixels, INTRINSICS), lens) for pixels in (pair.pixels_1, pair.pixels_2)]
    geometry = two_view_geometry(*seen, lens, lens)
    assert geometry.kind == "general"
    assert geometry.inliers.mean() > 0.98
    assert angle_deg(geometry.camera[:, :3], pair.camera[:, :3]) < 1e-3


def test_the_same_seed_gives_the_same_bits() -> None:
    pair = pair_of("general", 4)
    with_noise_and_outliers(pair, 4, 0.5)
    first, second = estimated(pair, known=True), estimated(pair, known=True)
    np.testing.assert_array_equal(first.camera, second.camera)
    np.testing.assert_array_equal(first.inliers, second.inliers)


def test_bad_arguments_are_named() -> None:
    with pytest.raises(InvalidArgument, match="pixels_2"):
        two_view_geometry(np.zeros((5, 2)), np.zeros((4, 2)))
    with pytest.raises(InvalidArgument, match="min_inliers = 7: must be at least 8"):
        two_view_geometry(np.zeros((9, 2)), np.zeros((9, 2)), min_inliers=7)
    with pytest.raises(InvalidArgument, match="threshold_px = 0"):
        two_view_geometry(np.zeros((9, 2)), np.zeros((9, 2)), threshold_px=0)
