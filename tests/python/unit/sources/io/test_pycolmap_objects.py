"""Reconstructions of pycolmap in memory: taken over, solved, handed back."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import sfmcpp
from io_helpers import assert_same_problem

pycolmap = pytest.importorskip("pycolmap")


def scene() -> sfmcpp.Problem:
    return sfmcpp.perturb(sfmcpp.circle_scene(6, 40, seed=1), point_sigma_m=0.1, seed=2)


def reconstruction(cameras_per_rig: int = 1) -> Any:
    """Six images of pycolmap's own synthetic scene."""
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig = 1, cameras_per_rig
    options.num_frames_per_rig = 6 // cameras_per_rig
    options.num_points3D, options.camera_model_id = 50, pycolmap.CameraModelId.SIMPLE_RADIAL
    options.camera_params = [1280.0, 512.0, 384.0, 0.01]
    pycolmap.set_random_seed(1)
    return pycolmap.synthesize_dataset(options)


def test_a_problem_comes_back_as_it_was() -> None:
    once = sfmcpp.from_pycolmap(sfmcpp.to_pycolmap(scene()))
    again = sfmcpp.from_pycolmap(sfmcpp.to_pycolmap(once))
    np.testing.assert_allclose(once.points, scene().points, rtol=0, atol=0)
    assert_same_problem(again, once, intrinsics_rtol=4e-16)


def test_residuals_are_those_that_pycolmap_computes() -> None:
    model = reconstruction()
    problem = sfmcpp.from_pycolmap(model)
    assert (problem.num_cameras, problem.num_points) == (model.num_images(), model.num_points3D())
    theirs = model.compute_mean_reprojection_error()
    # pycolmap's synthetic keypoints are exact to single precision.
    assert theirs == pytest.approx(np.linalg.norm(sfmcpp.residuals(problem), axis=1).mean(), abs=1e-3)


def test_errors_of_points_are_those_of_the_solved_state() -> None:
    problem = scene()
    before = sfmcpp.to_pycolmap(problem)
    sfmcpp.solve(problem)
    after = sfmcpp.to_pycolmap(problem)
    written = np.array([after.points3D[i].error for i in sorted(after.points3D)])
    after.update_point_3d_errors()
    theirs = np.array([after.points3D[i].error for i in sorted(after.points3D)])
    np.testing.assert_allclose(written, theirs, rtol=1e-9)
    assert written.mean() < 0.5 * np.mean([p.error for p in before.points3D.values()])


def test_names_and_identifiers_are_kept() -> None:
    model = reconstruction()
    again = sfmcpp.to_pycolmap(sfmcpp.from_pycolmap(model))
    assert {i: image.name for i, image in again.images.items()} == {
        i: image.name for i, image in model.images.items()
    }
    assert sorted(again.points3D) == sorted(model.points3D)


def test_rigs_of_several_cameras_are_refused() -> None:
    with pytest.raises(sfmcpp.InvalidArgument, match=r"^reconstruction: rigs: rig \d+ has 2 sensors"):
        sfmcpp.from_pycolmap(reconstruction(cameras_per_rig=2))


def test_anything_else_is_refused_by_name() -> None:
    with pytest.raises(
        sfmcpp.InvalidArgument, match=r"reconstruction is a str, must be a pycolmap\.Reconstr"
    ):
        sfmcpp.from_pycolmap("sparse/0")


def test_what_no_file_of_colmap_can_hold_is_refused_by_name() -> None:
    problem = scene()
    problem.points[3, 1] = np.nan
    with pytest.raises(sfmcpp.InvalidArgument, match=r"^problem: .*points\[3"):
        sfmcpp.to_pycolmap(problem)
