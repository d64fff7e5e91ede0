"""g2o's bundle adjustments: two cameras and three points, written in both dialects by its rules."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import sfmcpp
from io_helpers import assert_same_metadata, assert_same_problem, residuals
from sfmcpp import DatasetError, Problem

Array = NDArray[np.float64]

CENTRES = np.array([[0.1, -0.2, 0.3], [1.0, 0.5, -0.5]])
HALF_TURNS = np.array([[0.1, -0.05, 0.02], [-0.04, 0.1, 0.0]])  # vector parts of the quaternions
POINTS = np.array([[0.0, 0.0, 5.0], [1.0, -1.0, 6.0], [-1.0, 0.5, 7.0]])
FX, FY, CX, CY = 500.0, 510.0, 320.0, 240.0
INFORMATION = (4.0, 1.0, 9.0)
POINT_IDS, CAMERA_IDS = (7, 5, 100), (30, 2)


def rotation(vector: Array) -> Array:
    """World_from_camera of a unit quaternion, by v ↦ v + 2 w (q × v) + 2 q × (q × v)."""
    scalar = np.sqrt(1 - vector @ vector)
    cross = np.array([[0, -vector[2], vector[1]], [vector[2], 0, -vector[0]], [-vector[1], vector[0], 0]])
    return np.asarray(np.eye(3) + 2 * scalar * cross + 2 * cross @ cross)


def pixel(camera: int, point: int, fy: float) -> tuple[float, float]:
    x, y, z = rotation(HALF_TURNS[camera]).T @ (POINTS[point] - CENTRES[camera])
    return FX * x / z + CX, fy * y / z + CY


def numbers(*values: float) -> str:
    return " ".join(repr(float(value)) for value in values)


def pose(camera: int) -> str:
    vector = HALF_TURNS[camera]
    return numbers(*CENTRES[camera], *vector, np.sqrt(1 - vector @ vector))


def points(word: str) -> list[str]:
    return [f"{word} {i} {numbers(*x)}" for i, x in zip(POINT_IDS, POINTS, strict=True)]


def edges(word: str, between: str, fy: float) -> list[str]:
    return [
        f"{word} {POINT_IDS[p]} {CAMERA_IDS[c]} {between}{numbers(*pixel(c, p, fy), *INFORMATION)}"
        for c in range(2)
        for p in range(3)
    ]


def own_lenses() -> list[str]:
    cameras = [f"VERTEX_CAM {i} {pose(c)} {numbers(FX, FY, CX, CY, 0.1)}" for c, i in enumerate(CAMERA_IDS)]
    return [*cameras, *points("VERTEX_XYZ"), "FIX 30 7", *edges("EDGE_PROJECT_P2MC", "", FY)]


def named_lenses() -> list[str]:
    cameras = [f"VERTEX_SE3:EXPMAP {i} {pose(c)}" for c, i in enumerate(CAMERA_IDS)]
    lens = f"PARAMS_CAMERAPARAMETERS 0 {numbers(FX, CX, CY, 0)}"
    return [lens, *cameras, "FIX 30", *points("VERTEX_TRACKXYZ"), "FIX 7",
            *edges("EDGE_PROJECT_XYZ2UV:EXPMAP", "0 ", FX)]  # fmt: skip


def problem_of(folder: Path, lines: list[str]) -> Problem:
    (folder / "a.g2o").write_text("# g2o\n\n" + "\n".join(lines) + "\n")
    return sfmcpp.read(folder / "a.g2o")


@pytest.mark.parametrize("lines", [own_lenses(), named_lenses()], ids=["own", "named"])
def test_both_dialects_have_poses_points_and_no_residuals(tmp_path: Path, lines: list[str]) -> None:
    problem = problem_of(tmp_path, lines)
    np.testing.assert_allclose(problem.centres, CENTRES, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(problem.points, POINTS)
    np.testing.assert_allclose(residuals(problem), 0, atol=1e-10)
    np.testing.assert_allclose(sfmcpp.residuals(problem), 0, atol=1e-9)
    a, b, c = INFORMATION
    assert problem.covariance_px2 is not None
    np.testing.assert_allclose(np.linalg.inv(problem.covariance_px2[4]), [[a, b], [b, c]], rtol=1e-14)
    np.testing.assert_array_equal(problem.fixed_cameras, [True, False])
    np.testing.assert_array_equal(problem.fixed_points, [True, False, False])
    assert problem.fixed_intrinsics.all()
    assert problem.metadata.image_names == ["30", "2"]
    assert problem.metadata.extra["g2o_point_ids"].tolist() == list(POINT_IDS)


@pytest.mark.parametrize("lines", [own_lenses(), named_lenses()], ids=["own", "named"])
def test_both_dialects_are_written_as_they_were_read(tmp_path: Path, lines: list[str]) -> None:
    problem = problem_of(tmp_path, lines)
    sfmcpp.write(problem, tmp_path / "again.g2o")
    again = sfmcpp.read(tmp_path / "again.g2o")
    assert_same_problem(again, problem)
    assert again.covariance_px2 is not None
    np.testing.assert_allclose(again.covariance_px2, problem.covariance_px2, rtol=1e-15)
    for name in ("fixed_cameras", "fixed_points"):
        np.testing.assert_array_equal(getattr(again, name), getattr(problem, name))
    assert_same_metadata(again, problem)
    words = {line.split()[0] for line in (tmp_path / "again.g2o").read_text().splitlines()}
    assert words == {line.split()[0].replace("VERTEX_XYZ", "VERTEX_TRACKXYZ") for line in lines}


def test_standard_deviations_are_written_as_information(tmp_path: Path) -> None:
    problem = sfmcpp.circle_scene(3, 8, camera_model="perspective", seed=0)
    problem.sigma_px = np.linspace(0.5, 2.0, problem.num_observations)
    sfmcpp.write(problem, tmp_path / "a.g2o")
    again = sfmcpp.read(tmp_path / "a.g2o")
    expected = problem.sigma_px[:, None, None] ** 2 * np.eye(2)
    np.testing.assert_allclose(again.covariance_px2, expected, rtol=1e-14)
    assert again.metadata.image_names == ["0", "1", "2"]
    assert again.metadata.extra["g2o_point_ids"].tolist() == list(range(3, 11))


@pytest.mark.parametrize("names", [["7", "8"], ["7", "07"], ["7", "a"], ["7", "9" * 12]])
def test_names_that_cannot_be_identifiers_are_counted(tmp_path: Path, names: list[str]) -> None:
    problem = problem_of(tmp_path, named_lenses())
    problem.metadata.image_names = names
    sfmcpp.write(problem, tmp_path / "again.g2o")
    assert sfmcpp.read(tmp_path / "again.g2o").metadata.image_names == ["0", "1"]


def test_a_disturbed_file_is_solved(tmp_path: Path) -> None:
    problem = problem_of(tmp_path, named_lenses())
    problem.points[1:] += 0.05
    problem.cameras[1, :, 3] += 0.01
    assert sfmcpp.solve(problem).final_cost < 1e-12


def test_information_of_one_pixel_is_the_default(tmp_path: Path) -> None:
    ones = [line.replace(numbers(*INFORMATION), "1 0 1") for line in own_lenses()]
    assert problem_of(tmp_path, ones).covariance_px2 is None


CHANGES = [
    (named_lenses(), 0, "EDGE_SE3:QUAT 1 2", 3, "'EDGE_SE3:QUAT' is no part of a bundle adjustment"),
    (named_lenses(), 1, "VERTEX_SE3:EXPMAP 30 1 2", 4, "VERTEX_SE3:EXPMAP takes 8 numbers, there are 3"),
    (named_lenses(), 4, "VERTEX_XYZ 5 1 2 3", 8, "id 5 is used twice"),
    (named_lenses(), 3, "FIX 31", 6, "id 31 is not that of a vertex"),
    (
        named_lenses(),
        8,
        "EDGE_PROJECT_XYZ2UV:EXPMAP 30 30 0 1 1 1 0 1",
        11,
        "id 30 is not that of such a vertex",
    ),
    (named_lenses(), 8, "EDGE_PROJECT_XYZ2UV:EXPMAP 7 30 9 1 1 1 0 1", 11, "id 9 is not"),
    (named_lenses(), 9, "EDGE_PROJECT_XYZ2UV:EXPMAP 7 30 0 1 1 1 0 1", 12, "observes this point twice"),
    (named_lenses(), 9, "EDGE_PROJECT_XYZ2UV:EXPMAP 5 30 0 1 1 1 2 1", 12, "not positive definite"),
    (named_lenses(), 0, "PARAMS_CAMERAPARAMETERS 0 -5 1 1 0", 3, "focal lengths must be positive"),
    (named_lenses(), 1, "VERTEX_SE3:EXPMAP 30 1 2 3 0 0 0 0", 4, "the quaternion is zero"),
    (named_lenses(), 1, "VERTEX_SE3:EXPMAP 30 1 2 3 0 0 0 nan", 4, "not a finite number"),
    (own_lenses(), 1, named_lenses()[2], 3, "VERTEX_CAM beside VERTEX_SE3:EXPMAP"),
    (own_lenses(), 8, named_lenses()[10], 11, "cameras of this file are of the other kind"),
]


@pytest.mark.parametrize(("lines", "row", "text", "number", "reason"), CHANGES)
def test_what_is_wrong_is_named_with_its_line(
    tmp_path: Path, lines: list[str], row: int, text: str, number: int, reason: str
) -> None:
    with pytest.raises(DatasetError, match=rf"a\.g2o:{number}: .*{reason}"):
        problem_of(tmp_path, [*lines[:row], text, *lines[row + 1 :]])


def test_different_intrinsics_of_one_camera_are_refused(tmp_path: Path) -> None:
    lines = ["PARAMS_CAMERAPARAMETERS 1 600 320 240 0", *named_lenses()]
    lines[-1] = lines[-1].replace("100 2 0 ", "100 2 1 ")
    with pytest.raises(DatasetError, match="name different intrinsics"):
        problem_of(tmp_path, lines)


def test_cameras_that_see_nothing_keep_their_intrinsics(tmp_path: Path) -> None:
    """Observations name the lens of a camera; those without got the first one."""
    problem = sfmcpp.circle_scene(3, 20, camera_model="perspective", seed=0)
    problem.intrinsics[:, 0] = [900.0, 1000.0, 1100.0]
    blind = problem.with_observations(problem.camera_index != 2)
    sfmcpp.write(blind, tmp_path / "p.g2o")
    found = sfmcpp.read(tmp_path / "p.g2o")
    assert found.intrinsics[found.intrinsics_index, 0].tolist() == [900.0, 1000.0, 1100.0]
    assert sfmcpp.cost(found) == pytest.approx(sfmcpp.cost(blind), rel=1e-9)


@pytest.mark.parametrize("correlation", [0.0, 0.6])
def test_uncertainties_follow_undistorted_pixels(correlation: float, tmp_path: Path) -> None:
    problem = sfmcpp.sphere_scene(
        6, 80, ball_m=9.0, camera_model="perspective", distortion=(-0.4, 0.05), pixel_sigma_px=0.02, seed=2
    )
    stated = np.array([[0.25, correlation * 0.3], [correlation * 0.3, 0.36]])
    problem.covariance_px2 = np.tile(stated, (problem.num_observations, 1, 1))
    sfmcpp.write(problem, tmp_path / "lens.g2o")
    again = sfmcpp.read(tmp_path / "lens.g2o")
    before, after = (np.linalg.norm(sfmcpp.residuals(p), axis=1) for p in (problem, again))
    np.testing.assert_allclose(after, before, rtol=2e-3)
    assert np.abs(again.covariance_px2 - stated).max() > 0.05


def test_one_pixel_in_the_distorted_image_is_the_uncertainty_where_none_is_stated(tmp_path: Path) -> None:
    problem = sfmcpp.sphere_scene(
        6, 80, ball_m=9.0, camera_model="perspective", distortion=(-0.4, 0.05), pixel_sigma_px=0.02, seed=2
    )
    assert problem.sigma_px is None
    sfmcpp.write(problem, tmp_path / "none.g2o")
    sfmcpp.write(replace(problem, sigma_px=1.0), tmp_path / "one.g2o")
    assert (tmp_path / "none.g2o").read_bytes() == (tmp_path / "one.g2o").read_bytes()
    again = sfmcpp.read(tmp_path / "none.g2o")
    assert sfmcpp.cost(again) == pytest.approx(sfmcpp.cost(problem), rel=2e-3)
