"""Relative pose against known truth, an independent optimiser, and its own named failures."""

from __future__ import annotations

import re
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from random_scenes import (
    INTRINSICS,
    Array,
    Pair,
    angle_deg,
    calibration,
    project,
    random_camera,
    random_pair,
    spoil,
)
from sfmcpp import InvalidArgument, circle_scene
from sfmcpp.geometry import RelativePose, relative_pose

SEEDS = st.integers(0, 2**32 - 1)


def noisy(pair: Pair, sigma_px: float, rng: np.random.Generator) -> tuple[Array, Array]:
    first, second = pair.pixels_1, pair.pixels_2
    return tuple(x + sigma_px * rng.standard_normal(x.shape) for x in (first, second))  # type: ignore[return-value]


def sampson_px(camera: Array, pixels_1: Array, pixels_2: Array) -> Array:
    """Signed Sampson distance, from the 3×3 matrices directly."""
    inverse = np.linalg.inv(calibration(INTRINSICS))
    x, y, z = camera[:, 3]
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    f = inverse.T @ cross @ camera[:, :3] @ inverse
    a, b = (np.column_stack([p, np.ones(len(p))]) for p in (pixels_1, pixels_2))
    gradient = np.column_stack([(b @ f.T)[:, :2], (a @ f)[:, :2]])
    return np.sum(a * (b @ f.T), axis=1) / np.linalg.norm(gradient, axis=1)


@settings(max_examples=30, deadline=None)
@given(SEEDS, st.floats(300, 3000), st.floats(0.8, 1.25), st.floats(-20, 20))
def test_exact_matches_give_the_true_pose(seed: int, f: float, aspect: float, skew: float) -> None:
    row = np.array([f, aspect, 320.0, 240.0, skew])
    pair = random_pair(seed, row=row)
    found = relative_pose(pair.pixels_1, pair.pixels_2, row)
    assert found.success
    assert found.inliers.all()
    np.testing.assert_allclose(found.camera, pair.camera, atol=1e-5)


@pytest.mark.parametrize("fraction", [0.1, 0.3, 0.5])
@pytest.mark.parametrize("seed", range(4))
def test_outliers_are_told_apart_and_leave_the_pose_alone(seed: int, fraction: float) -> None:
    rng = np.random.default_rng(seed)
    pair = random_pair(seed, 400)
    pixels_1, pixels_2 = noisy(pair, 0.5, rng)
    spoilt = spoil(pixels_2, fraction, rng)
    found = relative_pose(pixels_1, pixels_2, INTRINSICS, threshold_px=2.0, seed=seed)
    # Outliers lie far outside of where points hold the pose: their errors under the true one may differ.
    far = np.abs(sampson_px(pair.camera, pixels_1, pixels_2)) > 3 * 2.0
    assert np.mean(found.inliers[~spoilt]) > 0.98
    assert not found.inliers[far].any()
    assert angle_deg(found.camera[:, :3], pair.camera[:, :3]) < 0.25
    assert angle_deg(found.camera[:, 3], pair.camera[:, 3]) < 1.0


def test_the_circular_scene_gives_the_true_pose() -> None:
    problem = circle_scene(30, 400, radius_m=8.0, focal_px=500.0, pixel_sigma_px=0.5, seed=3)
    first, second = (problem.camera_index == camera for camera in (0, 2))
    common, in_1, in_2 = np.intersect1d(
        problem.point_index[first], problem.point_index[second], return_indices=True
    )
    found = relative_pose(
        problem.pixels[first][in_1], problem.pixels[second][in_2], problem.intrinsics[0], threshold_px=2.0
    )
    turn = problem.rotations[0].T
    assert len(common) > 300
    assert angle_deg(found.camera[:, :3], turn @ problem.rotations[2]) < 0.25
    assert angle_deg(found.camera[:, 3], turn @ (problem.centres[2] - problem.centres[0])) < 0.25


def test_the_pose_minimises_the_robust_sampson_error() -> None:
    pair = random_pair(8, 150)
    pixels = noisy(pair, 0.7, np.random.default_rng(8))
    found = relative_pose(*pixels, INTRINSICS, threshold_px=6.0)
    assert found.inliers.all()

    def residuals(x: Array) -> Array:
        turn = found.camera[:, :3] @ Rotation.from_rotvec(x[:3]).as_matrix()
        return sampson_px(np.column_stack([turn, found.camera[:, 3] + x[3:]]), *pixels)

    best = least_squares(residuals, np.zeros(6), loss="cauchy", f_scale=6.0, xtol=1e-14, ftol=1e-14)
    ours = least_squares(residuals, np.zeros(6), loss="cauchy", f_scale=6.0, max_nfev=1).cost
    assert ours <= best.cost * (1 + 1e-4)
    truth = 0.5 * np.sum(sampson_px(pair.camera, *pixels) ** 2)
    assert 0.9 * truth < ours < truth


def test_the_baseline_has_length_one_and_inliers_are_within_the_threshold() -> None:
    rng = np.random.default_rng(9)
    pixels_1, pixels_2 = noisy(random_pair(9), 1.0, rng)
    found = relative_pose(pixels_1, pixels_2, INTRINSICS, threshold_px=1.0)
    errors = np.abs(sampson_px(found.camera, pixels_1, pixels_2))
    assert np.linalg.norm(found.camera[:, 3]) == pytest.approx(1.0)
    np.testing.assert_array_equal(found.inliers, errors <= 1.0)
    assert 0 < found.num_inliers < len(errors)


def test_points_behind_a_camera_are_no_inliers() -> None:
    pair = random_pair(10)
    behind = pair.points[:40] * [1, 1, -1]
    pixels_1 = np.vstack([pair.pixels_1, project(np.eye(3, 4), INTRINSICS, behind)])
    pixels_2 = np.vstack([pair.pixels_2, project(pair.camera, INTRINSICS, behind)])
    assert np.abs(sampson_px(pair.camera, pixels_1, pixels_2)).max() < 1e-6
    found = relative_pose(pixels_1, pixels_2, INTRINSICS)
    np.testing.assert_array_equal(found.inliers, np.arange(240) < 200)


def test_two_cameras_may_differ() -> None:
    other = np.array([450.0, 1.0, 200.0, 150.0, 0.0])
    pair = random_pair(11)
    found = relative_pose(pair.pixels_1, project(pair.camera, other, pair.points), INTRINSICS, other)
    np.testing.assert_allclose(found.camera, pair.camera, atol=1e-5)


def test_normalised_points_give_what_their_pixels_give() -> None:
    rng = np.random.default_rng(12)
    row = np.array([800.0, 1.0, 320.0, 240.0, 0.0])
    pair = random_pair(12, row=row)
    pixels = noisy(pair, 0.5, rng)
    spoil(pixels[1], 0.3, rng)
    normalised = [(x - row[2:4]) / row[0] for x in pixels]
    in_px = relative_pose(*pixels, row, threshold_px=2.0, min_parallax_px=3.0)
    plain = relative_pose(
        *normalised, [1, 1, 0, 0, 0], threshold_px=2.0 / row[0], min_parallax_px=3.0 / row[0]
    )
    np.testing.assert_array_equal(plain.inliers, in_px.inliers)
    np.testing.assert_allclose(plain.camera, in_px.camera, atol=1e-6)
    assert plain.median_parallax_px * row[0] == pytest.approx(in_px.median_parallax_px, rel=1e-5)


def test_the_seed_decides_the_samples() -> None:
    rng = np.random.default_rng(13)
    pixels = noisy(random_pair(13), 1.0, rng)
    spoil(pixels[1], 0.2, rng)
    hasty: dict[str, Any] = {
        "max_iterations": 1,
        "threshold_px": 5.0,
        "min_inliers": 5,
        "min_inlier_ratio": 1e-9,
    }
    cameras = [relative_pose(*pixels, INTRINSICS, seed=seed, **hasty).camera for seed in (1, 1, 2)]
    np.testing.assert_array_equal(cameras[0], cameras[1])
    assert not np.array_equal(cameras[0], cameras[2])


@settings(max_examples=20, deadline=None)
@given(SEEDS, st.floats(0, 0.6), st.floats(0, 0.3))
def test_a_pure_rotation_is_named_and_found(seed: int, sigma_px: float, outliers: float) -> None:
    rng = np.random.default_rng(seed)
    pair = random_pair(seed, 300)
    turn = np.column_stack([pair.camera[:, :3], np.zeros(3)])
    pair.pixels_2 = project(turn, INTRINSICS, pair.points)
    pixels = noisy(pair, sigma_px, rng)
    spoil(pixels[1], outliers, rng)
    found = relative_pose(*pixels, INTRINSICS, seed=seed)
    assert found.failure == "rotation only"
    assert f"median parallax {found.median_parallax_px:.3g} px, must be at least 2 px" in found.message
    assert angle_deg(found.camera[:, :3], turn[:, :3]) < 0.05 + 0.1 * sigma_px
    np.testing.assert_array_equal(found.camera[:, 3], 0.0)


def test_a_standing_camera_is_named_a_rotation() -> None:
    pixels = random_pair(14).pixels_1
    found = relative_pose(pixels, pixels, INTRINSICS)
    assert found.failure == "rotation only"
    np.testing.assert_allclose(found.camera, np.eye(3, 4), atol=1e-12)


def test_a_small_baseline_passes_when_less_parallax_is_asked_for() -> None:
    pair = random_pair(15)
    camera = pair.camera * [1, 1, 1, 0.005]
    pixels_2 = project(camera, INTRINSICS, pair.points)
    assert relative_pose(pair.pixels_1, pixels_2, INTRINSICS).failure == "rotation only"
    found = relative_pose(pair.pixels_1, pixels_2, INTRINSICS, threshold_px=0.01, min_parallax_px=0.05)
    assert found.success
    np.testing.assert_allclose(found.camera, pair.camera, atol=1e-3)
    at_depth = 0.005 * INTRINSICS[0] / pair.points[:, 2]
    assert 0.2 * np.median(at_depth) < found.median_parallax_px < 1.2 * np.median(at_depth)


def narrow_pose(
    seed: int, count: int, half_width: float, depths: tuple[float, float]
) -> tuple[RelativePose, float]:
    """Relative pose from points in a narrow box, and the error of its rotation [deg]."""
    rng = np.random.default_rng(seed)
    camera = random_camera(rng, 0.8, 0.1)
    corner = np.array([half_width, half_width, depths[1]])
    points = rng.uniform([-half_width, -half_width, depths[0]], corner, (count, 3))
    images = (project(c, INTRINSICS, points) for c in (np.eye(3, 4), camera))
    pixels = [x + 0.5 * rng.standard_normal(x.shape) for x in images]
    found = relative_pose(*pixels, INTRINSICS, threshold_px=1.5, seed=seed)
    return found, angle_deg(found.camera[:, :3], camera[:, :3])


def test_poses_that_the_matches_hardly_choose_between_are_named() -> None:
    poses = [narrow_pose(seed, 20, 1.5, (10, 12)) for seed in range(60)]
    wrong = [found for found, error_deg in poses if error_deg > 5.0]
    named = [found for found in wrong if found.failure == "ambiguous"]
    assert len(wrong) >= 6
    assert len(named) >= 0.85 * len(wrong)
    assert all(
        re.search(r"another pose, turned by [\d.]+ deg, fits nearly as well", x.message) for x in named
    )


def test_enough_matches_in_depth_are_not_called_ambiguous() -> None:
    for seed in range(40):
        found, error_deg = narrow_pose(seed, 40, 2.5, (8, 12))
        assert found.success
        assert error_deg < 1.5


@pytest.mark.parametrize("count", [0, 4, 14])
def test_too_few_matches_are_named(count: int) -> None:
    pair = random_pair(16, 14)
    found = relative_pose(pair.pixels_1[:count], pair.pixels_2[:count], INTRINSICS)
    assert (found.failure, found.message) == ("too few matches", f"{count} matches: must be at least 15")
    assert np.isnan(found.camera).all()
    assert found.inliers.shape == (count,)


@pytest.mark.parametrize("count", [50, 400, 2000])
def test_matches_at_random_give_no_pose(count: int) -> None:
    pixels = np.random.default_rng(count).uniform(0, [640, 480], (2, count, 2))
    found = relative_pose(*pixels, INTRINSICS, max_iterations=1000)
    assert found.failure == "too few inliers"
    assert f"must be at least {max(15, count // 5)}" in found.message
    assert np.isnan(found.camera).all()


GOOD = random_pair(17, 20)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pixels_1": GOOD.pixels_1[:, :1]}, r"pixels_1: shape \(20, 1\), must be \(any, 2\)"),
        ({"pixels_2": GOOD.pixels_2[:19]}, r"pixels_2: shape \(19, 2\), must be \(20, 2\)"),
        ({"pixels_2": GOOD.pixels_2 * np.nan}, r"pixels_2\[0, 0\] = nan: must be finite"),
        ({"pixels_1": "text"}, "pixels_1 = 'text': must be an array of numbers"),
        ({"intrinsics_1": [500.0, 1.0, 0.0, 0.0]}, r"intrinsics_1: shape \(4,\), must be \(5\)"),
        ({"intrinsics_1": [-500.0, 1.0, 0, 0, 0]}, r"intrinsics_1\[0\] = -500.0: f must be positive"),
        ({"intrinsics_2": [500.0, 0.0, 0, 0, 0]}, r"intrinsics_2\[1\] = 0.0: aspect must be positive"),
        ({"threshold_px": 0.0}, "threshold_px = 0.0: must be finite and positive"),
        ({"min_inliers": 4}, "min_inliers = 4: must be at least 5"),
        ({"min_inlier_ratio": 1.0}, "min_inlier_ratio = 1.0: must lie between 0 and 1"),
        ({"min_parallax_px": float("nan")}, "min_parallax_px = nan: must be finite and positive"),
        ({"confidence": 1.0}, "confidence = 1.0: must lie between 0 and 1"),
        ({"max_iterations": 0}, "max_iterations = 0: must be at least 1"),
        ({"seed": -1}, "seed = -1: must be an integer from 0"),
        ({"seed": 0.5}, "seed = 0.5: must be an integer from 0"),
    ],
)
def test_a_bad_argument_is_named_with_its_value(change: dict[str, Any], message: str) -> None:
    good = {"pixels_1": GOOD.pixels_1, "pixels_2": GOOD.pixels_2, "intrinsics_1": INTRINSICS}
    with pytest.raises(InvalidArgument, match=message):
        relative_pose(**{**good, **change})


@pytest.mark.parametrize(
    ("machine", "version", "remedy"),
    [
        ("x86_64", (3, 14), r"pip install 'sfmcpp\[vision\]'"),
        ("aarch64", (3, 14), "it must be built here, as docs/install.md has it"),
        ("x86_64", (3, 15), "it must be built here, as docs/install.md has it"),
    ],
)
def test_without_poselib_the_error_names_the_remedy(
    monkeypatch: pytest.MonkeyPatch, machine: str, version: tuple[int, int], remedy: str
) -> None:
    monkeypatch.setitem(sys.modules, "poselib", None)
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setattr("sys.version_info", version)
    monkeypatch.setattr("platform.machine", lambda: machine)
    with pytest.raises(ModuleNotFoundError, match=f"need poselib: {remedy}"):
        relative_pose(GOOD.pixels_1, GOOD.pixels_2, INTRINSICS)


def test_importing_the_geometry_does_not_load_poselib() -> None:
    code = "import sfmcpp.geometry, sys; sys.exit('poselib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
