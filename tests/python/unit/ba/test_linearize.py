"""The linear model against plain references: whole steps, and dense matrices of the full normal equations."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import sfmcpp
from constrained import positions, random_group, scene, weighted_errors
from dense_models import (
    METRIC,
    assert_same_covariance,
    dense_covariance,
    odd_problem,
    problem_of,
    root_of_normal_matrix,
)
from sfmcpp import CONSTRAINT_KINDS, ConstraintGroup, InvalidArgument, LinearModel, Problem

Array = NDArray[np.float64]
STEP = 1e-6


def stepped(problem: Problem, model: LinearModel, step: Array) -> Problem:
    """The problem moved along a step of all columns."""
    padded = np.append(step, 0.0)
    moved = problem.copy()
    by_camera = padded[model.camera_columns]
    moved.cameras[:, :, :3] = problem.rotations @ Rotation.from_rotvec(by_camera[:, :3]).as_matrix()
    moved.cameras[:, :, 3] += by_camera[:, 3:6]
    names = list(problem.intrinsic_names)
    for k, name in enumerate(model.parameter_names[6:], start=6):
        moved.intrinsics[problem.intrinsics_index, names.index(name)] = (
            problem.intrinsics[problem.intrinsics_index, names.index(name)] + by_camera[:, k]
        )
    free = model.point_columns >= 0
    moved.points[free] += step[model.num_camera_columns :].reshape(-1, 3)
    return moved


@pytest.mark.parametrize("camera_model", METRIC)
def test_residuals_answer_to_a_step_as_the_jacobian_says(camera_model: str) -> None:
    problem = odd_problem(camera_model)
    problem.fixed_cameras[1] = True
    model = sfmcpp.linearize(problem)
    step = np.random.default_rng(3).standard_normal(model.num_columns)
    ends = [sfmcpp.residuals(stepped(problem, model, s * STEP * step)) for s in (1, -1)]
    expected = (ends[0] - ends[1]) / (2 * STEP)
    np.testing.assert_allclose((model.jacobian() @ step).reshape(-1, 2), expected, rtol=1e-5, atol=1e-4)
    np.testing.assert_array_equal(model.residuals, sfmcpp.residuals(problem))
    assert (model.camera_columns[1, :6] == -1).all()
    assert model.point_columns[3] == -1


@pytest.mark.parametrize("kind", CONSTRAINT_KINDS)
def test_rows_of_a_constraint_are_its_errors_and_answer_to_a_step_as_they_do(kind: str) -> None:
    problem = scene()
    group = random_group(problem, kind)
    model = sfmcpp.linearize(problem, constraints=[group])
    (rows,) = model.groups
    assert rows.weight == group.weight
    assert rows.squared_error == pytest.approx((weighted_errors(problem, group) ** 2).sum() / group.weight)
    assert model.group_costs[group.name] == pytest.approx(0.5 * (weighted_errors(problem, group) ** 2).sum())
    step = np.random.default_rng(2).standard_normal(model.num_columns)
    if "reproj" in kind:  # frozen intrinsics: the reference would move them
        step[model.camera_columns[:, 6:]] = 0.0
    ends = [weighted_errors(stepped(problem, model, s * STEP * step), group) for s in (1, -1)]
    expected = (ends[0] - ends[1]) / (2 * STEP * np.sqrt(group.weight))
    found = rows.jacobian() @ step[: model.num_camera_columns]
    expected = expected[np.abs(expected) > 0]  # the reference has rows of zeros below a pose
    found = found[np.abs(found) > 1e-12 * np.abs(found).max()]
    np.testing.assert_allclose(np.sort(found), np.sort(expected), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("gauge", ["free", "fixed"])
@pytest.mark.parametrize("constrained", [False, True])
@pytest.mark.parametrize("camera_model", METRIC)
def test_covariances_are_those_of_the_dense_normal_matrix(
    camera_model: str, constrained: bool, gauge: str
) -> None:
    problem = odd_problem(camera_model)
    groups = [positions(problem, problem, weight=300.0)] if constrained else []
    model = sfmcpp.linearize(problem, constraints=groups, gauge=gauge, datum="all")
    expected = dense_covariance(model)
    found = model.covariance(cameras="all", points="all", joint=True)
    of_points = np.where(model.point_columns[:, None] < 0, -1, model.point_columns[:, None] + np.arange(3))
    columns = np.concatenate([model.camera_columns.ravel(), of_points.ravel()])
    known = np.flatnonzero(columns >= 0)
    assert found.joint is not None
    assert_same_covariance(
        found.joint[np.ix_(known, known)], expected[np.ix_(columns[known], columns[known])]
    )
    blocks = [*found.cameras, *found.points]
    begin = 0
    for block in blocks:
        end = begin + len(block)
        np.testing.assert_allclose(block, found.joint[begin:end, begin:end], rtol=1e-7, atol=1e-16)
        begin = end
    assert not found.points[3].any()


@pytest.mark.parametrize("camera_model", METRIC)
def test_the_free_gauge_of_bare_images_has_seven_freedoms_and_covariances_of_least_norm(
    camera_model: str,
) -> None:
    problem = problem_of(camera_model)
    free, fixed = (sfmcpp.linearize(problem, gauge=gauge, datum="all") for gauge in ("free", "fixed"))
    assert free.num_columns - fixed.num_columns == 7
    assert free.num_determined == np.linalg.matrix_rank(root_of_normal_matrix(free)) == fixed.num_determined
    assert_same_covariance(free.covariance(points=[5]).points[0], _point_block(free, 5))
    trace = np.trace(dense_covariance(free))
    cameras, points = (free.covariance(cameras="all").cameras, free.covariance(points="all").points)
    if camera_model != "shared":
        found = np.einsum("kii->", cameras) + np.einsum("kii->", points)
        assert found == pytest.approx(trace, rel=1e-9)
    np.testing.assert_allclose(free.leverages(), fixed.leverages(), atol=1e-9)


def _point_block(model: LinearModel, point: int) -> Array:
    first = model.point_columns[point]
    return dense_covariance(model)[first : first + 3, first : first + 3]


def test_a_camera_that_constraints_alone_hold_moves_with_the_world() -> None:
    """In the free gauge: the motions that no residual sees are its motions, too."""
    seen = problem_of("calibrated")
    pairs = np.array([[2, 3], [3, 4]])
    poses = np.concatenate([seen.cameras, np.tile([[[0.0, 0.0, 0.0, 1.0]]], (6, 1, 1))], axis=1)
    steps = np.linalg.inv(poses[pairs[:, 0]]) @ poses[pairs[:, 1]]
    odometer = ConstraintGroup("displacement-pose", pairs, steps[:, :3], weight=100.0)
    unseen = seen.with_observations(seen.camera_index != 3)
    model = sfmcpp.linearize(unseen, constraints=[odometer], datum="all")
    for camera, found in enumerate(model.covariance(cameras="all").cameras):
        columns = model.camera_columns[camera]
        assert_same_covariance(found, dense_covariance(model)[np.ix_(columns, columns)])


@pytest.mark.parametrize("loss", ["squared", "huber", "cauchy"])
@pytest.mark.parametrize("camera_model", METRIC)
def test_leverages_hats_and_determinant_are_those_of_the_dense_normal_matrix(
    camera_model: str, loss: str
) -> None:
    problem = odd_problem(camera_model)
    groups = [
        positions(problem, problem, weight=300.0),
        random_group(problem, "displacement-rotation", name="turns"),
    ]
    scale = 1.0 if loss == "squared" else 3.0
    model = sfmcpp.linearize(problem, constraints=groups, loss=loss, loss_scale_px=scale)
    covariance, jacobian = (
        dense_covariance(model),
        model.jacobian().toarray().reshape(-1, 2, model.num_columns),
    )
    expected = jacobian @ covariance @ np.swapaxes(jacobian, 1, 2)
    np.testing.assert_allclose(model.leverages(), expected, atol=1e-9)
    n = model.num_camera_columns
    for k, rows in enumerate(model.groups):
        own = rows.jacobian().toarray()
        hat = rows.weight * own @ covariance[:n, :n] @ own.T
        np.testing.assert_allclose(model.hat_matrix(k), hat, atol=1e-9)
    normal = model.normal_matrix().toarray()
    schur = normal[:n, :n] - normal[:n, n:] @ np.linalg.solve(normal[n:, n:], normal[n:, :n])
    assert model.log_determinant == pytest.approx(np.linalg.slogdet(schur)[1], abs=1e-6)
    used = np.trace(model.leverages(), axis1=1, axis2=2).sum()
    used += sum(np.trace(model.hat_matrix(k)) for k in range(2))
    assert used == pytest.approx(model.num_determined, abs=1e-6)


@pytest.mark.parametrize("loss", ["squared", "tukey"])
@pytest.mark.parametrize("camera_model", METRIC)
def test_a_step_goes_to_the_minimum_of_the_linear_model(camera_model: str, loss: str) -> None:
    problem = odd_problem(camera_model)
    group = positions(problem, problem, weight=300.0)
    assert group.values is not None
    group.values[:, 0] += 0.05
    scale = 1.0 if loss == "squared" else 50.0
    model = sfmcpp.linearize(problem, constraints=[group], loss=loss, loss_scale_px=scale)
    assert (
        model.cost
        == sfmcpp.solve(
            problem.copy(), constraints=[group], loss=loss, loss_scale_px=scale, max_iterations=1
        ).initial_cost
    )
    roots = np.sqrt(model.observation_weights)[:, None]
    errors = np.concatenate([(roots * model.residuals).ravel(), np.sqrt(300.0) * model.groups[0].errors])
    matrix = root_of_normal_matrix(model)
    expected = -np.linalg.lstsq(matrix, errors, rcond=None)[0]
    found = model.step()
    reached = stepped(problem, model, expected)
    np.testing.assert_allclose(found.problem.points, reached.points, atol=1e-8)
    np.testing.assert_allclose(found.problem.cameras, reached.cameras, atol=1e-8)
    np.testing.assert_allclose(found.problem.intrinsics, reached.intrinsics, atol=1e-6)
    left = errors + matrix @ expected
    np.testing.assert_allclose(np.sqrt(300.0) * found.errors[0], left[-18:], atol=1e-8)
    assert found.decrease == pytest.approx(0.5 * (errors @ errors - left @ left), rel=1e-9)


def test_the_bits_do_not_depend_on_the_threads() -> None:
    truth = sfmcpp.circle_scene(20, 200, pixel_sigma_px=1.0)
    group = positions(truth, truth, weight=300.0)
    one, two = (sfmcpp.linearize(truth, constraints=[group], threads=n) for n in (1, 2))
    np.testing.assert_array_equal(one.leverages(), two.leverages())
    np.testing.assert_array_equal(one.hat_matrix(0), two.hat_matrix(0))
    np.testing.assert_array_equal(one.step().problem.points, two.step().problem.points)


def test_a_large_sparse_system_is_solved_like_a_dense_one() -> None:
    problem = sfmcpp.street_loop_scene(120, 900, pixel_sigma_px=1.0, seed=1)
    group = positions(problem, problem, weight=30.0)
    model = sfmcpp.linearize(problem, constraints=[group])
    n = model.num_camera_columns
    normal = model.normal_matrix().toarray()
    scale = np.sqrt(np.diag(normal))
    covariance = np.linalg.inv(normal / np.outer(scale, scale)) / np.outer(scale, scale)
    found = model.covariance(cameras=[7, 90], joint=True).joint
    assert found is not None
    columns = model.camera_columns[[7, 90]].ravel()
    np.testing.assert_allclose(found, covariance[np.ix_(columns, columns)], rtol=1e-6, atol=1e-12)
    schur = normal[:n, :n] - normal[:n, n:] @ np.linalg.solve(normal[n:, n:], normal[n:, :n])
    assert model.log_determinant == pytest.approx(np.linalg.slogdet(schur)[1], abs=1e-6)


def test_a_projective_problem_has_a_jacobian_of_fifteen_freedoms_and_no_covariance() -> None:
    problem = sfmcpp.as_projective(scene("calibrated"))
    model = sfmcpp.linearize(problem)
    sizes = np.linalg.svd(model.jacobian().toarray(), compute_uv=False)
    scales = problem.num_cameras  # twelve columns, eleven freedoms
    assert np.count_nonzero(sizes < 1e-9 * sizes[0]) == 15 + scales
    with pytest.raises(InvalidArgument, match="camera_model = 'projective': its gauge of 15 degrees"):
        model.covariance(cameras=[0])


def test_what_nothing_determines_is_named() -> None:
    problem = scene("calibrated")
    once = problem.point_index == 4
    once[np.flatnonzero(once)[0]] = False
    fewer = Problem(
        "calibrated",
        problem.cameras,
        problem.intrinsics,
        problem.points,
        problem.camera_index[~once],
        problem.point_index[~once],
        problem.pixels[~once],
    )
    model = sfmcpp.linearize(fewer)
    assert np.isfinite(model.covariance(cameras="all").cameras).all()
    with pytest.raises(InvalidArgument, match="point 4: its position is not determined"):
        model.covariance(points=[4])
    with pytest.raises(InvalidArgument, match=r"cameras: 6, must be in \[0, 6\)"):
        model.covariance(cameras=[6])
    with pytest.raises(InvalidArgument, match="points = 'some': must be numbers or 'all'"):
        model.covariance(points="some")  # type: ignore[arg-type]
    with pytest.raises(InvalidArgument, match="gauge = 'loose'"):
        sfmcpp.linearize(fewer, gauge="loose")


def test_more_than_the_gauge_left_open_is_refused() -> None:
    truth = sfmcpp.circle_scene(6, 40, seed=2)
    apart = (truth.camera_index < 3) == (truth.point_index < 20)  # two parts without a common point
    problem = Problem(
        "calibrated",
        truth.cameras,
        truth.intrinsics,
        truth.points,
        truth.camera_index[apart],
        truth.point_index[apart],
        truth.pixels[apart],
    )
    with pytest.raises(InvalidArgument, match=r"not determine|singular"):
        sfmcpp.linearize(problem).covariance(cameras="all")


def test_losses_and_their_slopes_are_their_own_derivatives() -> None:
    from sfmcpp import _core

    s, h = np.array([0.1, 2.0, 8.0, 10.0, 50.0]), 1e-5
    for loss in sfmcpp.ba.LOSSES:
        rho, slope, influence = _core.loss_terms(loss, 3.0, s)
        above, below = (_core.loss_terms(loss, 3.0, x) for x in (s + h, s - h))
        np.testing.assert_allclose(slope, (above[0] - below[0]) / (2 * h), rtol=1e-6, atol=1e-9)
        grown = (s + h) * above[1] - (s - h) * below[1]
        np.testing.assert_allclose(influence, grown / (2 * h), rtol=1e-6, atol=1e-9)
        assert (rho <= s).all()


def test_groups_without_weight_and_members_without_weight_are_told_apart() -> None:
    problem = scene("calibrated")
    group = ConstraintGroup("position", np.arange(6), problem.centres + 1.0, weight=0.0)
    group.member_weights[2] = 0.0
    (rows,) = sfmcpp.linearize(problem, constraints=[group]).groups
    assert rows.weight == 0.0
    assert sorted(set(rows.member.tolist())) == [0, 1, 3, 4, 5]
    assert rows.squared_error == pytest.approx(5.0)


def test_leverages_do_not_depend_on_how_weakly_the_gauge_is_held() -> None:
    problem = problem_of("calibrated")
    weak, weaker = (
        sfmcpp.linearize(problem, constraints=[positions(problem, problem, weight=w)]).leverages()
        for w in (1e-4, 1e-6)
    )
    np.testing.assert_allclose(weak, weaker, atol=1e-5)


def test_a_model_stays_what_it_was_where_arrays_of_its_problem_change() -> None:
    problem = problem_of("shared")
    group = ConstraintGroup("position", [1, 2], problem.centres[[1, 2]] + 0.1, sigma=0.5)
    model = sfmcpp.linearize(problem, constraints=[group])
    before = model.normal_matrix().toarray(), model.gradient(), model.step().problem.points
    for name in ("cameras", "points", "pixels", "intrinsics"):
        getattr(problem, name)[:] += 1.0
    for name in ("camera_index", "point_index", "intrinsics_index"):
        getattr(problem, name)[:] = np.roll(getattr(problem, name), 1)
    after = model.normal_matrix().toarray(), model.gradient(), model.step().problem.points
    for expected, found in zip(before, after, strict=True):
        np.testing.assert_array_equal(found, expected)
