"""Outliers: the asked share, really wrong, and nothing else touched."""

from __future__ import annotations

import numpy as np
import pytest

import sfmcpp
from sfmcpp import InvalidArgument, Problem
from sfmcpp.sources.synthetic import add_outliers, circle_scene


@pytest.fixture(scope="module")
def scene() -> Problem:
    return circle_scene(20, 500, pixel_sigma_px=0.5, seed=2)


@pytest.mark.parametrize(
    ("share", "expected"), [(0.0, 0), (0.00004, 0), (0.1, 1000), (0.12345, 1234), (1.0, 10_000)]
)
def test_exactly_the_asked_share_is_replaced(scene: Problem, share: float, expected: int) -> None:
    wrong, is_outlier = add_outliers(scene, share, seed=1)
    assert is_outlier.sum() == expected
    np.testing.assert_array_equal((wrong.pixels != scene.pixels).all(axis=1), is_outlier)
    np.testing.assert_array_equal((wrong.pixels == scene.pixels).all(axis=1), ~is_outlier)


def test_the_original_and_all_but_the_pixels_are_untouched(scene: Problem) -> None:
    before = scene.copy()
    wrong, _ = add_outliers(scene, 0.5, seed=1)
    np.testing.assert_array_equal(scene.pixels, before.pixels)
    for array in ("cameras", "points", "intrinsics", "camera_index", "point_index"):
        np.testing.assert_array_equal(getattr(wrong, array), getattr(before, array))


@pytest.mark.parametrize(("camera_model", "first_corner"), [("perspective", (0, 0)), ("bal", (-320, -240))])
def test_outliers_are_uniform_in_the_image(camera_model: str, first_corner: tuple[int, int]) -> None:
    problem = circle_scene(20, 500, camera_model=camera_model, seed=3)
    wrong, _ = add_outliers(problem, 1.0, seed=1)
    shares = (wrong.pixels - first_corner) / [640, 480]
    assert 0 <= shares.min() < 0.001
    assert 0.999 < shares.max() <= 1
    np.testing.assert_allclose(shares.mean(axis=0), 0.5, atol=0.015)
    np.testing.assert_allclose(shares.std(axis=0), 1 / np.sqrt(12), rtol=0.03)
    assert abs(np.corrcoef(shares.T)[0, 1]) < 0.04


def test_outliers_of_a_given_deviation_stay_near(scene: Problem) -> None:
    wrong, is_outlier = add_outliers(scene, 0.5, sigma_px=20.0, seed=1)
    steps = (wrong.pixels - scene.pixels)[is_outlier]
    np.testing.assert_allclose(steps.std(axis=0), 20.0, rtol=0.05)
    np.testing.assert_allclose(steps.mean(axis=0), 0.0, atol=1.2)


def test_outliers_are_spread_over_all_cameras_and_points(scene: Problem) -> None:
    _, is_outlier = add_outliers(scene, 0.2, seed=1)
    by_camera = np.bincount(scene.camera_index[is_outlier], minlength=20)
    # 500 observations a camera: binomial with a deviation of √(500 · 0.2 · 0.8) = 9; two-sided at four.
    assert (np.abs(by_camera - 100) < 36).all()
    assert np.corrcoef(is_outlier[:-1], is_outlier[1:])[0, 1] == pytest.approx(0, abs=0.04)


def test_the_seed_decides_and_a_larger_share_keeps_the_smaller(scene: Problem) -> None:
    small, is_small = add_outliers(scene, 0.1, seed=5)
    again, _ = add_outliers(scene, 0.1, seed=5)
    large, is_large = add_outliers(scene, 0.3, seed=5)
    _, is_other = add_outliers(scene, 0.1, seed=6)
    np.testing.assert_array_equal(small.pixels, again.pixels)
    assert is_large[is_small].all()
    np.testing.assert_array_equal(large.pixels[is_small], small.pixels[is_small])
    assert not np.array_equal(is_small, is_other)


def test_a_robust_solve_is_not_led_astray_by_them(scene: Problem) -> None:
    def error_of_distances(problem: Problem) -> float:
        """Relative, of all distances between points up to one scale: free of the gauge."""
        shape, truth = (np.linalg.norm(p.points[:250] - p.points[250:], axis=1) for p in (problem, scene))
        return float(np.std(shape / truth))

    errors = {}
    for loss in ("squared", "cauchy"):
        problem, _ = add_outliers(scene, 0.1, seed=4)
        sfmcpp.solve(problem, loss=loss)
        errors[loss] = error_of_distances(problem)
    assert errors["cauchy"] < 0.003
    assert errors["squared"] > 10 * errors["cauchy"]


def test_unknown_image_sizes_are_told(scene: Problem) -> None:
    problem = scene.copy()
    problem.metadata = sfmcpp.Metadata()
    with pytest.raises(InvalidArgument, match="sigma_px = None"):
        add_outliers(problem, 0.1, seed=0)
    assert add_outliers(problem, 0.1, sigma_px=5.0, seed=0)[1].sum() == 1000


@pytest.mark.parametrize(
    ("share", "sigma_px", "message"),
    [
        (-0.1, None, "share = -0.1"),
        (1.1, None, "share = 1.1"),
        (float("nan"), None, "share = nan"),
        (0.1, 0.0, "sigma_px = 0.0"),
        (0.1, float("inf"), "sigma_px = inf"),
    ],
)
def test_a_bad_argument_is_named_with_its_value(
    scene: Problem, share: float, sigma_px: float | None, message: str
) -> None:
    with pytest.raises(InvalidArgument, match=message):
        add_outliers(scene, share, sigma_px=sigma_px, seed=0)
