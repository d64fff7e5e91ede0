"""Blocks of the normal equations against plain references: whole steps, dense inverses, the core's costs."""

from __future__ import annotations

import numpy as np
import pytest

import sfmcpp
from constrained import random_group, scene, weighted_errors
from sfmcpp import CONSTRAINT_KINDS, InvalidArgument, Problem
from sfmcpp.ba.options import SolveOptions
from sfmcpp.geometry.so3 import exp
from sfmcpp.weighting.whole import reduced_system
from sfmcpp.weighting.whole.columns import CameraColumns, camera_columns
from sfmcpp.weighting.whole.constraint_rows import constraint_rows
from sfmcpp.weighting.whole.image_jacobian import image_jacobian
from sfmcpp.weighting.whole.reduced_system import ReducedSystem
from sfmcpp.weighting.whole.robust_loss import influence_slope, rho, rho_slope
from weight_helpers import Array, dense_jacobian, dense_rows, gps, small_scene

STEP = 1e-6
LOSSES = ("squared", "huber", "cauchy", "tukey")


def stepped(problem: Problem, columns: CameraColumns, step: Array) -> Problem:
    """The problem moved along a step of the cameras' columns."""
    padded = np.append(step, 0.0)
    moved = problem.copy()
    poses = padded[columns.pose]
    moved.cameras[:, :, :3] = problem.rotations @ exp(poses[:, :3])
    moved.cameras[:, :, 3] += poses[:, 3:]
    moved.intrinsics += padded[columns.intrinsics]
    return moved


@pytest.mark.parametrize("kind", CONSTRAINT_KINDS)
def test_rows_of_a_constraint_are_its_errors_and_answer_to_a_step_as_they_do(kind: str) -> None:
    problem = scene()
    group = random_group(problem, kind)
    columns = camera_columns(problem)
    rows = constraint_rows(group, problem, columns)
    root = np.sqrt(group.weight)
    assert rows.squared_error == pytest.approx((weighted_errors(problem, group) ** 2).sum() / group.weight)
    step = np.random.default_rng(2).standard_normal(columns.count)
    ends = [weighted_errors(stepped(problem, columns, s * STEP * step), group) for s in (1, -1)]
    expected = (ends[0] - ends[1]) / (2 * STEP * root)
    found = rows.jacobian @ step
    if "reproj" in kind:  # frozen intrinsics: the step of them is left out of the reference's images
        columns_of_poses = columns.pose[columns.pose < columns.count]
        step[np.setdiff1d(np.arange(columns.count), columns_of_poses)] = 0.0
        ends = [weighted_errors(stepped(problem, columns, s * STEP * step), group) for s in (1, -1)]
        expected, found = (ends[0] - ends[1]) / (2 * STEP * root), rows.jacobian @ step
    expected = expected[np.abs(expected) > 0]  # the reference has rows of zeros below a pose
    found = found[np.abs(found) > 1e-12 * np.abs(found).max()]
    np.testing.assert_allclose(np.sort(found), np.sort(expected), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("camera_model", ["calibrated", "perspective", "bal"])
def test_the_image_jacobian_answers_to_a_step_as_the_residuals_do(camera_model: str) -> None:
    problem = scene(camera_model)
    problem.fixed_cameras[1] = True
    problem.fixed_points[3] = True
    jacobian = image_jacobian(problem)
    rng = np.random.default_rng(3)
    step = rng.standard_normal(jacobian.cameras.count)
    by_point = rng.standard_normal(problem.points.shape) * ~problem.fixed_points[:, None]
    ends = []
    for sign in (STEP, -STEP):
        moved = stepped(problem, jacobian.cameras, sign * step)
        moved.points += sign * by_point
        ends.append(sfmcpp.residuals(moved))
    expected = (ends[0] - ends[1]) / (2 * STEP)
    found = np.einsum("oik,ok->oi", jacobian.by_camera, np.append(step, 0.0)[jacobian.columns])
    found += np.einsum("oik,ok->oi", jacobian.by_point, by_point[problem.point_index])
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-4)


def test_intrinsics_shared_by_cameras_share_their_columns() -> None:
    problem = scene("perspective")
    shared = Problem(
        "perspective",
        problem.cameras,
        problem.intrinsics[:2],
        problem.points,
        problem.camera_index,
        problem.point_index,
        problem.pixels,
        intrinsics_index=np.array([0, 0, 0, 1, 1, 1], dtype=np.int32),
    )
    system, dense = ReducedSystem(image_jacobian(shared), np.ones(len(shared.pixels))), dense_jacobian(shared)
    normal = dense.T @ dense
    n = system.columns
    assert n == 6 * 6 + 2
    schur = normal[:n, :n] - normal[:n, n:] @ np.linalg.solve(normal[n:, n:], normal[n:, :n])
    np.testing.assert_allclose(system.images, schur, rtol=1e-6, atol=1e-8 * np.abs(schur).max())


def test_inverse_parameters_and_leverages_are_those_of_the_dense_normal_matrix() -> None:
    problem, truth = small_scene()
    problem.fixed_points[3] = True
    group = gps(truth, 0.1)
    counts = np.random.default_rng(1).uniform(0.2, 1, len(problem.pixels))
    jacobian = dense_jacobian(problem) * np.sqrt(np.repeat(counts, 2))[:, None]
    rows = np.sqrt(3 / 0.1**2) * dense_rows(group, problem)[1]
    normal = jacobian.T @ jacobian + rows.T @ rows
    inverse = np.linalg.pinv(normal, hermitian=True)
    leverages = [jacobian[i : i + 2] @ inverse @ jacobian[i : i + 2].T for i in range(0, len(jacobian), 2)]
    system = ReducedSystem(image_jacobian(problem), counts)
    n = system.columns
    found = system.inverse(rows[:, :n])
    np.testing.assert_allclose(found.covariance, inverse[:n, :n], rtol=1e-4, atol=1e-6 * inverse.max())
    assert found.parameters == pytest.approx(np.linalg.matrix_rank(normal), abs=1e-3)
    np.testing.assert_allclose(system.leverages(found.covariance), leverages, atol=1e-5)
    schur = system.images + rows[:, :n].T @ rows[:, :n]
    assert found.log_determinant == pytest.approx(np.linalg.slogdet(schur)[1], abs=1e-3)


def test_leverages_do_not_depend_on_how_weakly_the_gauge_is_held() -> None:
    problem, truth = small_scene()
    system = ReducedSystem(image_jacobian(problem), np.ones(len(problem.pixels)))
    _, rows = dense_rows(gps(truth, 0.1), problem)
    weak, weaker = (system.inverse(np.sqrt(w) * rows[:, : system.columns]) for w in (1e-4, 1e-6))
    np.testing.assert_allclose(
        system.leverages(weak.covariance), system.leverages(weaker.covariance), atol=1e-5
    )


def test_too_many_columns_are_refused_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reduced_system, "MAX_COLUMNS", 30)
    problem, _ = small_scene()
    with pytest.raises(InvalidArgument, match="36 free parameters of cameras, must be at most 30"):
        ReducedSystem(image_jacobian(problem), np.ones(len(problem.pixels)))


@pytest.mark.parametrize("loss", LOSSES)
def test_losses_are_those_of_the_core_and_slopes_their_derivatives(loss: str) -> None:
    problem, _ = small_scene()
    options = SolveOptions(loss=loss, loss_scale_px=3.0)
    squared = (sfmcpp.residuals(problem) ** 2).sum(axis=1)
    core = sfmcpp.solve(problem.copy(), loss=loss, loss_scale_px=3.0, max_iterations=1).initial_cost
    assert 0.5 * rho(options, squared).sum() == pytest.approx(core, rel=1e-12)
    s = np.array([0.1, 2.0, 8.0, 10.0, 50.0])
    h = 1e-5
    slope = (rho(options, s + h) - rho(options, s - h)) / (2 * h)
    np.testing.assert_allclose(rho_slope(options, s), slope, rtol=1e-6, atol=1e-9)
    grown = [t * rho_slope(options, t) for t in (s + h, s - h)]
    np.testing.assert_allclose(
        influence_slope(options, s), (grown[0] - grown[1]) / (2 * h), rtol=1e-6, atol=1e-9
    )
