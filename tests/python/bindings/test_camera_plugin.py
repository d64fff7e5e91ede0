"""The fisheye plug-in against the same lens as a Python function, in builds that have the plug-in."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import sfmcpp
from sfmcpp import CAMERA_MODELS, CameraFunction, Problem

Array = NDArray[np.float64]

pytestmark = pytest.mark.skipif(
    "fisheye" not in CAMERA_MODELS, reason="not built with SFMCPP_CAMERA_PLUGIN=examples/plugins/fisheye.hpp"
)
ROW = np.array([[420.0, 430.0, 300.0, 250.0, 0.05, -0.03, 0.02, -0.01]])


def fisheye(points: Array, intrinsics: Array) -> Array:
    fx, fy, cx, cy, *k = intrinsics.T
    radius = np.hypot(points[:, 0], points[:, 1])
    angle = np.arctan2(radius, points[:, 2])
    scale = angle * (1 + sum(c * angle ** (2 * n + 2) for n, c in enumerate(k))) / radius
    return np.stack([fx * scale * points[:, 0] + cx, fy * scale * points[:, 1] + cy], axis=1)


def starts() -> tuple[Problem, Problem]:
    """The plug-in's problem, and the function's: wide images of a cube around which cameras stand."""
    scene = sfmcpp.circle_scene(8, 100, camera_model="calibrated", seed=1)
    function = CameraFunction(fisheye, CAMERA_MODELS["fisheye"].intrinsics)
    centres = scene.cameras / [1, 1, 1, 2.5]
    own = Problem(
        function,
        centres,
        np.repeat(ROW, 8, axis=0),
        scene.points,
        scene.camera_index,
        scene.point_index,
        scene.pixels,
    )
    noise = np.random.default_rng(2).normal(0, 0.5, own.pixels.shape)
    own.pixels[:] = own.pixels - sfmcpp.residuals(own) + noise
    own = sfmcpp.perturb(own, point_sigma_m=0.03, position_sigma_m=0.03, rotation_sigma_deg=0.5, seed=3)
    own.set_free_intrinsics("fx", "fy", "k1")
    return replace(own.copy(), camera_model="fisheye"), own


def test_pixels_and_derivatives_are_those_of_the_function() -> None:
    plugin, own = starts()
    np.testing.assert_allclose(sfmcpp.residuals(plugin), sfmcpp.residuals(own), atol=1e-10)
    assert sfmcpp.check_jacobians(plugin, 100).worst_error < 1e-6


def test_both_come_to_the_same_minimum() -> None:
    plugin, own = starts()
    for problem in (plugin, own):
        sfmcpp.solve(problem, gauge="fixed")
        # Undamped, to all digits: with damping, costs no longer tell states apart that differ in the ninth.
        options = {"method": "gauss-newton", "function_tolerance": 1e-16, "max_iterations": 50}
        sfmcpp.solve(problem, gauge="fixed", **options)  # type: ignore[arg-type]
    np.testing.assert_allclose(plugin.cameras, own.cameras, atol=1e-9)
    np.testing.assert_allclose(plugin.points, own.points, atol=1e-9)
    np.testing.assert_allclose(plugin.intrinsics, own.intrinsics, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    "options", [{"line_search": "t-als"}, {"loss": "auto"}, {"acceleration": "geodesic"}]
)
def test_the_plug_in_solves_with_what_functions_cannot(options: dict[str, str]) -> None:
    plugin, own = starts()
    sfmcpp.solve(own, gauge="fixed")
    sfmcpp.solve(plugin, gauge="fixed", **options)  # type: ignore[arg-type]
    assert sfmcpp.cost(plugin) == pytest.approx(sfmcpp.cost(own), rel=1e-4)


def test_files_keep_the_name_of_the_plug_in(tmp_path: Path) -> None:
    plugin, _ = starts()
    sfmcpp.write(plugin, tmp_path / "fisheye.npz")
    again = sfmcpp.read(tmp_path / "fisheye.npz")
    assert again.camera_model == "fisheye"
    np.testing.assert_array_equal(again.intrinsics, plugin.intrinsics)
    with pytest.raises(sfmcpp.DatasetError, match="holds calibrated, perspective, bal cameras only"):
        sfmcpp.write(plugin, tmp_path / "fisheye.txt")
