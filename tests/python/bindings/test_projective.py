"""Projective problems: made from matrices or from metric problems, solved, kept and refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import sfmcpp
from sfmcpp import DatasetError, InvalidArgument, Problem
from sfmcpp.ba import explore_step


def scene(camera_model: str = "calibrated", noise_px: float = 1.0) -> Problem:
    return sfmcpp.circle_scene(8, 60, camera_model=camera_model, pixel_sigma_px=noise_px, seed=4)


def perturbed(problem: Problem) -> Problem:
    return sfmcpp.perturb(problem, point_sigma_m=0.3, position_sigma_m=0.5, rotation_sigma_deg=3, seed=5)


def images(matrices: np.ndarray, problem: Problem) -> np.ndarray:
    """Projections by plain matrix products."""
    points = problem.points
    if points.shape[1] == 3:
        points = np.concatenate([points, np.ones((len(points), 1))], axis=1)
    seen = np.einsum("mij,mj->mi", matrices[problem.camera_index], points[problem.point_index])
    return seen[:, :2] / seen[:, 2:]


def distorted_scene() -> Problem:
    problem = scene("bal", noise_px=0.0)
    problem.intrinsics[:, 1:] = [-0.2, 0.05]
    problem.pixels += sfmcpp.residuals(problem) * -1.0  # exact images of the distorted cameras
    return problem


def test_residuals_are_those_of_the_matrix_products() -> None:
    problem = sfmcpp.as_projective(perturbed(scene()))
    expected = problem.pixels - images(sfmcpp.projection_matrices(problem), problem)
    np.testing.assert_allclose(sfmcpp.residuals(problem), expected, rtol=1e-10, atol=1e-9)


@pytest.mark.parametrize("model", ["calibrated", "perspective", "bal"])
def test_forgetting_the_calibration_leaves_every_residual(model: str) -> None:
    problem = perturbed(scene(model))
    np.testing.assert_allclose(
        sfmcpp.residuals(sfmcpp.as_projective(problem)), sfmcpp.residuals(problem), rtol=1e-9, atol=1e-8
    )


def test_forgetting_a_distorted_calibration_undistorts_the_pixels() -> None:
    problem = distorted_scene()
    assert np.abs(sfmcpp.residuals(problem)).max() < 1e-9
    assert np.abs(sfmcpp.residuals(sfmcpp.as_projective(problem))).max() < 1e-6


def test_images_are_normalised_and_scales_are_one() -> None:
    problem = sfmcpp.as_projective(scene())
    scale, centre = problem.intrinsics[:, :1], problem.intrinsics[:, 1:]
    for camera in range(problem.num_cameras):
        seen = problem.pixels[problem.camera_index == camera]
        normalised = (seen - centre[camera]) / scale[camera]
        np.testing.assert_allclose(normalised.mean(axis=0), 0, atol=1e-12)
        assert np.linalg.norm(normalised, axis=1).mean() == pytest.approx(np.sqrt(2))
    np.testing.assert_allclose(np.linalg.norm(problem.cameras, axis=(1, 2)), 1)
    np.testing.assert_allclose(np.linalg.norm(problem.points, axis=1), 1)


@pytest.mark.parametrize("linear_solver", ["dense", "sparse", "iterative"])
def test_a_projective_minimum_is_below_the_calibrated_one(linear_solver: str) -> None:
    calibrated = perturbed(scene())
    projective = sfmcpp.as_projective(calibrated)
    lower = sfmcpp.solve(projective, linear_solver=linear_solver, max_iterations=100)
    upper = sfmcpp.solve(calibrated)
    assert lower.converged
    # 11 parameters a camera instead of 6 fit the noise a little closer, not ten times closer.
    assert 0.5 * upper.final_cost < lower.final_cost < upper.final_cost
    assert sfmcpp.cost(projective) == pytest.approx(lower.final_cost, rel=1e-9)


def test_the_minimum_does_not_depend_on_the_frame_of_the_world() -> None:
    start = perturbed(scene())
    matrices = sfmcpp.projection_matrices(start)
    homogeneous = np.concatenate([start.points, np.ones((start.num_points, 1))], axis=1)
    move = np.array([[2.0, 0.1, 0, 300], [0, 3, 0.2, -100], [0.1, 0, 1, 50], [0, 0, 0, 1]])
    moved = sfmcpp.projective_problem(
        matrices @ np.linalg.inv(move),
        homogeneous @ move.T,
        start.camera_index,
        start.point_index,
        start.pixels,
    )
    here = sfmcpp.as_projective(start)
    costs = [sfmcpp.solve(p, function_tolerance=1e-12, max_iterations=200).final_cost for p in (here, moved)]
    assert costs[1] == pytest.approx(costs[0], rel=1e-6)


def test_what_is_fixed_keeps_its_bits() -> None:
    problem = sfmcpp.as_projective(perturbed(scene()))
    problem.fixed_cameras[[0, 3]] = True
    problem.fixed_points[[5, 7]] = True
    before = problem.copy()
    assert sfmcpp.solve(problem).converged
    np.testing.assert_array_equal(problem.cameras[[0, 3]], before.cameras[[0, 3]])
    np.testing.assert_array_equal(problem.points[[5, 7]], before.points[[5, 7]])
    assert (problem.cameras[1] != before.cameras[1]).any()


def test_analytic_derivatives_are_the_numeric_ones() -> None:
    assert sfmcpp.check_jacobians(sfmcpp.as_projective(perturbed(scene()))).worst_error < 1e-6


@pytest.mark.parametrize("options", [{"gauge": "fixed"}, {"method": "gauss-newton"}])
def test_a_fixed_gauge_is_refused(options: dict[str, str]) -> None:
    with pytest.raises(InvalidArgument, match="projective"):
        sfmcpp.solve(sfmcpp.as_projective(scene()), **options)


def test_zero_coordinates_are_refused_by_place() -> None:
    problem = sfmcpp.as_projective(scene())
    problem.points[7] = 0
    with pytest.raises(InvalidArgument, match=r"points\[7\]"):
        sfmcpp.check(problem)
    matrices = sfmcpp.projection_matrices(scene())
    matrices[2] = 0
    with pytest.raises(InvalidArgument, match=r"projections\[2\]"):
        sfmcpp.projective_problem(matrices, problem.points[:7], [0], [0], [[1.0, 2.0]])


def test_only_the_own_format_holds_projective_problems(tmp_path: Path) -> None:
    problem = sfmcpp.as_projective(scene())
    sfmcpp.write(problem, tmp_path / "kept.npz")
    np.testing.assert_array_equal(sfmcpp.read(tmp_path / "kept.npz").cameras, problem.cameras)
    with pytest.raises(DatasetError, match=r"metric cameras only: use \.npz"):
        sfmcpp.write(problem, tmp_path / "lost.txt")


def test_the_algebraic_cost_is_that_in_the_frame_of_a_solve() -> None:
    """By the formulas of docs/equations.md §5, up to the scales of the candidate's matrices."""
    problem = sfmcpp.as_projective(perturbed(scene()))
    places = problem.points[:, :3] / problem.points[:, 3:]
    middle = np.median(places, axis=0)
    size = 0.1 / np.median(np.linalg.norm(places - middle, axis=1))
    frame = np.vstack([size * np.column_stack([np.eye(3), -middle]), [0, 0, 0, 1]])

    def in_frame(state: Problem) -> tuple[np.ndarray, np.ndarray]:
        return state.cameras @ np.linalg.inv(frame), state.points @ frame.T

    def scaled(values: np.ndarray, start: np.ndarray) -> np.ndarray:
        """So that what is added to the start is at right angles to it."""
        axes = tuple(range(1, values.ndim))
        return values / (values * start).sum(axis=axes, keepdims=True)

    cameras, points = (
        x / np.linalg.norm(x.reshape(len(x), -1), axis=1).reshape(-1, *[1] * (x.ndim - 1))
        for x in in_frame(problem)
    )
    lengths = [(0.0, 0.0), (1.0, 1.0), (0.3, 1.4)]
    step = explore_step(problem, lengths, damping_matrix="identity")
    moved = [scaled(x, start) for x, start in zip(in_frame(step.candidate), (cameras, points), strict=True)]
    for (of_cameras, of_points), found in zip(lengths, step.algebraic, strict=True):
        p, q = cameras + of_cameras * (moved[0] - cameras), points + of_points * (moved[1] - points)
        seen = np.einsum("mij,mj->mi", p[problem.camera_index], q[problem.point_index])
        scale, centre = np.split(problem.intrinsics[problem.camera_index], [1], axis=1)
        image = (problem.pixels - centre) / scale
        errors = seen[:, :2] - image * seen[:, 2:]
        assert found == pytest.approx(0.5 * np.sum(errors**2), rel=1e-9)


def test_a_projective_copy_shares_nothing_with_its_problem() -> None:
    problem = scene()
    problem.sigma_px = np.full(problem.num_observations, 2.0)
    problem.metadata.image_names = [f"{k}.jpg" for k in range(problem.num_cameras)]
    projective = sfmcpp.as_projective(problem)
    for name in ("camera_index", "point_index", "sigma_px", "fixed_cameras", "points", "pixels"):
        assert not np.shares_memory(getattr(projective, name), getattr(problem, name)), name
    projective.metadata.image_names.clear()
    assert len(problem.metadata.image_names) == problem.num_cameras


@pytest.mark.parametrize("name", ["camera_index", "point_index"])
def test_a_projective_problem_refuses_what_is_none_of_its_cameras_and_points(name: str) -> None:
    problem = scene()
    indices = {k: getattr(problem, k).copy() for k in ("camera_index", "point_index")}
    indices[name][3] = 1000
    with pytest.raises(InvalidArgument, match=f"{name}: must be from 0 to"):
        sfmcpp.projective_problem(
            sfmcpp.projection_matrices(problem), problem.points, pixels=problem.pixels, **indices
        )
