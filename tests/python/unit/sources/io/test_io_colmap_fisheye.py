"""COLMAP models with fisheye lenses: read, adjusted and written as OpenCV and COLMAP understand them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sfmcpp
from io_helpers import refusal
from sfmcpp.errors import DatasetError
from sfmcpp.sources.io import read, write
from sfmcpp.sources.io.colmap.fisheye import FISHEYE, jacobians, project

LENS = np.array([400.0, 1.02, 512.0, 384.0, 0.05, -0.02, 0.01, -0.003])
PARAMS = {
    "SIMPLE_RADIAL_FISHEYE": [400.0, 512.0, 384.0, 0.05],
    "RADIAL_FISHEYE": [400.0, 512.0, 384.0, 0.05, -0.02],
    "OPENCV_FISHEYE": [400.0, 408.0, 512.0, 384.0, 0.05, -0.02, 0.01, -0.003],
    "SIMPLE_FISHEYE": [400.0, 512.0, 384.0],
    "FISHEYE": [400.0, 408.0, 512.0, 384.0],
}
# How many of the intrinsics each has: f, aspect, cx, cy, k1, k2, k3, k4.
KEPT = dict(zip(PARAMS, (5, 6, 8, 4, 4), strict=True))
FREE = dict(zip(PARAMS, (2, 3, 6, 1, 2), strict=True))


def wide_points(count: int = 400) -> np.ndarray:
    """Directions all round but backwards, some on the axis or close to it."""
    points = np.random.default_rng(0).normal(size=(count, 3))
    points[:50, :2] *= 1e-5
    points[:5, :2] = 0.0
    points[:50, 2] = np.abs(points[:50, 2]) + 0.2
    return points


def scene(row: np.ndarray = LENS) -> sfmcpp.Problem:
    """A camera inside a cloud of points, with half a pixel of noise."""
    rng = np.random.default_rng(1)
    poses = sfmcpp.circle_scene(8, 10, seed=0).cameras / [1, 1, 1, 10]
    points = rng.normal(0, 3, (120, 3))
    camera, point = (index.ravel() for index in np.indices((8, 120)))
    seen = np.einsum("nji,nj->ni", poses[camera, :, :3], points[point] - poses[camera, :, 3])
    ahead = seen[:, 2] > 0.3
    camera, point, seen = camera[ahead], point[ahead], seen[ahead]
    pixels = project(seen, np.repeat(row[None], len(seen), axis=0)) + rng.normal(0, 0.5, (len(seen), 2))
    arrays = (poses, row[None].copy(), points, camera, point, pixels)
    return sfmcpp.Problem(FISHEYE, *arrays, intrinsics_index=np.zeros(8, int))


def test_images_are_those_of_opencv() -> None:
    cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed: pip install 'sfmcpp[vision]'")
    points = wide_points()
    points = points[points[:, 2] > 0.05]
    matrix = np.array([[400.0, 0, 512], [0, 408, 384], [0, 0, 1]])
    expected, _ = cv2.fisheye.projectPoints(points[:, None], np.zeros(3), np.zeros(3), matrix, LENS[4:])
    ours = project(points, np.tile(LENS, (len(points), 1)))
    np.testing.assert_allclose(ours, expected.reshape(-1, 2), rtol=0, atol=1e-8)


def test_derivatives_are_those_of_differences() -> None:
    points = wide_points()
    rows = np.tile(LENS, (len(points), 1))
    by_point, by_intrinsics = jacobians(points, rows)
    steps = 1e-6 * np.eye(3)
    found = [(project(points + h, rows) - project(points - h, rows)) / 2e-6 for h in steps]
    scale = np.abs(by_point).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(by_point / scale, np.stack(found, axis=2) / scale, rtol=0, atol=1e-8)
    steps = 1e-4 * np.eye(8)
    found = [(project(points, rows + h) - project(points, rows - h)) / 2e-4 for h in steps]
    np.testing.assert_allclose(by_intrinsics, np.stack(found, axis=2), rtol=1e-7, atol=1e-6)


def test_derivatives_close_to_the_axis_behind_the_camera_are_those_of_differences() -> None:
    points = np.array([[1e-5, 2e-5, -1.0], [2e-6, 0.0, -2.0], [0.0, -3e-5, -0.5]])
    rows = np.tile(LENS, (len(points), 1))
    by_point, _ = jacobians(points, rows)
    steps = 1e-9 * np.eye(3)
    found = [(project(points + h, rows) - project(points - h, rows)) / 2e-9 for h in steps]
    scale = np.abs(by_point).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(by_point / scale, np.stack(found, axis=2) / scale, rtol=0, atol=1e-5)


@pytest.mark.parametrize("format", ["colmap-text", "colmap-binary"])
@pytest.mark.parametrize("model", PARAMS)
def test_a_model_keeps_its_lens(tmp_path: Path, model: str, format: str) -> None:
    row = np.where(np.arange(8) < KEPT[model], LENS, 0.0)
    row[1] = LENS[1] if model in ("OPENCV_FISHEYE", "FISHEYE") else 1.0
    problem = scene(row)
    problem.metadata.extra["colmap_camera_models"] = [model]
    problem.fixed_intrinsics[:] = True
    write(problem, tmp_path / "a", format=format)
    again = read(tmp_path / "a")
    assert again.camera_model is FISHEYE
    assert again.metadata.extra["colmap_camera_models"] == [model]
    np.testing.assert_allclose(again.intrinsics, problem.intrinsics, rtol=1e-15)
    assert sfmcpp.cost(again) == pytest.approx(sfmcpp.cost(problem), rel=1e-9)
    assert np.count_nonzero(~again.fixed_intrinsics) == FREE[model]


def test_an_adjusted_model_is_written_with_the_errors_of_its_points(tmp_path: Path) -> None:
    start = sfmcpp.perturb(scene(), position_sigma_m=0.02, point_sigma_m=0.05, rotation_sigma_deg=0.5, seed=2)
    write(start, tmp_path / "start")
    problem = read(tmp_path / "start")
    summary = sfmcpp.solve(problem)
    assert summary.termination == "converged"
    assert 0.4 < summary.final_rms_px < 0.52
    write(problem, tmp_path / "end", format="colmap-text")
    lines = (tmp_path / "end/points3D.txt").read_text().splitlines()
    told = [float(line.split()[7]) for line in lines if not line.startswith("#")]
    lengths = np.linalg.norm(sfmcpp.residuals(problem), axis=1)
    expected = np.bincount(problem.point_index, lengths) / np.bincount(problem.point_index)
    np.testing.assert_allclose(told, expected[expected > 0], rtol=1e-6)


@pytest.mark.parametrize("model", PARAMS)
def test_an_adjustment_ends_where_colmap_ends(model: str) -> None:
    pycolmap: Any = pytest.importorskip("pycolmap")
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig = 1, 1, 8
    options.num_points3D = 150
    options.camera_model_id = getattr(pycolmap.CameraModelId, model)
    options.camera_params = PARAMS[model]
    pycolmap.set_random_seed(1)
    theirs = pycolmap.synthesize_dataset(options)
    noise = pycolmap.SyntheticNoiseOptions()
    noise.point2D_stddev, noise.point3D_stddev = 0.7, 0.02
    noise.rig_from_world_translation_stddev, noise.rig_from_world_rotation_stddev = 0.02, 0.3
    pycolmap.synthesize_noise(noise, theirs)
    ours = sfmcpp.from_pycolmap(theirs)
    summary = sfmcpp.solve(ours, max_iterations=200, function_tolerance=1e-12)
    solver = pycolmap.BundleAdjustmentOptions()
    solver.print_summary = False
    pycolmap.bundle_adjustment(theirs, solver)
    assert summary.final_cost == pytest.approx(sfmcpp.cost(sfmcpp.from_pycolmap(theirs)), rel=1e-7)
    (camera,) = sfmcpp.to_pycolmap(ours).cameras.values()
    assert camera.model.name == model


def test_lenses_of_two_kinds_are_refused(tmp_path: Path) -> None:
    write(scene(), tmp_path / "m", format="colmap-text")
    cameras = tmp_path / "m/cameras.txt"
    cameras.write_text(cameras.read_text() + "2 PINHOLE 1024 768 400 400 512 384\n")
    assert "its lens differs from the first one's: must be a fisheye, too" in str(refusal(tmp_path / "m"))


def test_other_formats_say_who_holds_a_fisheye(tmp_path: Path) -> None:
    write(scene(), tmp_path / "points.ply")
    with pytest.raises(DatasetError, match="'fisheye' is a function, which only COLMAP models hold"):
        write(scene(), tmp_path / "a.npz")
