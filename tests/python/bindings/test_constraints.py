"""Constraints on cameras as Python sees them: costs against NumPy, minima against SciPy, what they do."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import sfmcpp
from constrained import CAMERAS, PAIRS, Array, matrix, positions, random_group, scene, weighted_errors
from projection import minimum_by_scipy, reference_residuals
from sfmcpp import CONSTRAINT_KINDS, ConstraintGroup, Problem


@pytest.mark.parametrize("kind", CONSTRAINT_KINDS)
def test_cost_of_a_group_is_half_its_weighted_mean_squared_errors(kind: str) -> None:
    problem = scene()
    group = random_group(problem, kind, name="sensor")
    summary = sfmcpp.solve(problem.copy(), constraints=[group], max_iterations=0)
    expected = 0.5 * np.sum(weighted_errors(problem, group) ** 2)
    assert expected > 1e-3
    assert summary.constraint_costs.keys() == {"sensor"}
    np.testing.assert_allclose(summary.constraint_costs["sensor"], [expected] * 2, rtol=1e-9)
    assert summary.initial_cost == pytest.approx(sfmcpp.cost(problem) + expected, rel=1e-12)
    assert summary.initial_rms_px == pytest.approx(np.sqrt(np.mean(sfmcpp.residuals(problem) ** 2)))


def test_intrinsics_may_be_compared_with_those_of_another_camera() -> None:
    problem = scene()
    problem.intrinsics[:, 0] = [500, 510, 520, 530, 540, 550]
    group = ConstraintGroup("focal", [[0, 1], [5, 2]])
    summary = sfmcpp.solve(problem, constraints=[group], max_iterations=0)
    expected = 0.5 * (np.log(500 / 510) ** 2 + np.log(550 / 520) ** 2)
    assert summary.constraint_costs["focal"][0] == pytest.approx(expected, rel=1e-12)


def test_each_number_of_a_vector_may_have_a_weight() -> None:
    """Against three groups of SciPy's making: a receiver with 3 cm along x and y and 12 cm along z."""
    problem = scene()
    sigma = np.array([0.03, 0.03, 0.12]) * np.arange(1, 7)[:, None]
    values = problem.centres + np.random.default_rng(2).normal(0, 0.1, (6, 3))
    group = ConstraintGroup("position", np.arange(6), values, 3.0, 1 / sigma**2, name="rtk")
    summary = sfmcpp.solve(problem.copy(), constraints=[group], max_iterations=0)
    expected = 0.5 * np.sum(((problem.centres - values) / sigma) ** 2)
    assert summary.constraint_costs["rtk"][0] == pytest.approx(expected, rel=1e-9)
    one_each = replace(group, member_weights=np.tile(np.arange(1.0, 7)[:, None], 3))
    by_member = replace(group, member_weights=np.arange(1.0, 7))
    costs = [sfmcpp.solve(problem.copy(), constraints=[g]).final_cost for g in (one_each, by_member, group)]
    assert costs[0] == pytest.approx(costs[1], rel=1e-9)
    assert costs[2] != pytest.approx(costs[1], rel=1e-3)


def test_a_number_of_weight_zero_holds_nothing() -> None:
    """Heights alone leave a world free to move aside and to turn about them."""
    problem, truth = scene("calibrated"), scene("calibrated")
    group = ConstraintGroup(
        "position", np.arange(6), truth.centres + np.array([50.0, 0, 0]), 1e4, np.tile([0, 1, 1.0], (6, 1))
    )
    sfmcpp.solve(problem, constraints=[group])
    assert np.abs(problem.centres - truth.centres)[:, 0].max() < 5


def test_weights_of_numbers_are_for_kinds_of_vectors() -> None:
    with pytest.raises(sfmcpp.InvalidArgument, match=r"member_weights: shape \(2, 3\), must be \(2\)"):
        ConstraintGroup("orientation", [0, 1], np.tile(np.eye(3), (2, 1, 1)), member_weights=np.ones((2, 3)))
    group = ConstraintGroup("position", [0], np.zeros((1, 3)), member_weights=[[1, -1, 1]])
    with pytest.raises(sfmcpp.InvalidArgument, match=r"weight = -1.0.*not negative"):
        sfmcpp.solve(scene(), constraints=[group])


# ρ(s) at scale 1.5, as thesis §2.3 and docs/equations.md have them.
RHO: dict[str, Callable[[float], float]] = {
    "squared": lambda s: s,
    "huber": lambda s: s if s <= 2.25 else 3 * np.sqrt(s) - 2.25,
    "cauchy": lambda s: 2.25 * np.log1p(s / 2.25),
}


def robust_errors(problem: Problem, group: ConstraintGroup) -> Array:
    """Errors of members whose squares are ρ of those without a loss."""
    parts = np.split(weighted_errors(problem, group), group.num_members)
    return np.concatenate([e * np.sqrt(RHO[group.loss](e @ e) / (e @ e)) for e in parts])


@pytest.mark.parametrize("loss", RHO)
def test_minimum_equals_that_of_scipy(loss: str) -> None:
    truth = sfmcpp.circle_scene(6, 30, camera_model="calibrated", seed=1)
    problem = scene("calibrated").with_points(np.arange(12))  # SciPy differentiates by each unknown
    rng = np.random.default_rng(8)
    moved_by = np.linalg.norm(truth.centres[PAIRS[:, 1]] - truth.centres[PAIRS[:, 0]], axis=1)
    groups = [
        ConstraintGroup("position", CAMERAS, truth.centres[CAMERAS] + rng.normal(0, 0.1, (3, 3)), 50.0),
        ConstraintGroup("scale", PAIRS, moved_by + rng.normal(0, 0.1, 3), 50.0),
    ]
    groups[0].values[0] += [3.0, 0.0, -2.0]  # type: ignore[index]
    for group in groups:
        group.loss, group.loss_scale = loss, 1.5

    def residuals_with_groups(moved: Problem) -> Array:
        pixels = reference_residuals(moved).ravel()
        return np.concatenate([pixels, *(robust_errors(moved, group) for group in groups)])

    expected = minimum_by_scipy(problem, residuals_with_groups)
    summary = sfmcpp.solve(problem, constraints=groups, function_tolerance=1e-14, max_iterations=200)
    assert summary.final_cost == pytest.approx(expected, rel=1e-6)
    assert sum(final for _, final in summary.constraint_costs.values()) > 1e-3 * summary.final_cost


@pytest.mark.parametrize("method", ["lm", "lm-nielsen", "dog-leg", "gauss-newton"])
@pytest.mark.parametrize("linear_solver", ["dense", "sparse", "iterative"])
def test_positions_recover_metric_scale_and_place(method: str, linear_solver: str) -> None:
    truth = sfmcpp.circle_scene(6, 30, camera_model="calibrated", pixel_sigma_px=0.0, seed=1)
    problem = truth.copy()
    turn = Rotation.from_rotvec([0.02, -0.01, 0.03]).as_matrix()
    problem.rotations[:] = turn @ truth.rotations
    problem.centres[:] = 1.2 * truth.centres @ turn.T + [1, 2, 3]
    problem.points[:] = 1.2 * truth.points @ turn.T + [1, 2, 3]
    exact = {"pcg_tolerance": 1e-8} if linear_solver == "iterative" else {}
    summary = sfmcpp.solve(
        problem,
        constraints=[positions(problem, truth, weight=1e4)],
        method=method,
        linear_solver=linear_solver,
        function_tolerance=1e-14,
        max_iterations=200,
        **exact,
    )
    assert summary.initial_rms_px < 1e-9
    assert np.abs(problem.centres - truth.centres).max() < 1e-4
    assert np.abs(problem.points - truth.points).max() < 1e-3


@pytest.mark.parametrize("method", ["lm-nielsen", "dog-leg", "gauss-newton"])
@pytest.mark.parametrize("search", ["none", "g-als", "backtracking"])
def test_a_robust_loss_ignores_a_wrong_position_with_any_method(method: str, search: str) -> None:
    truth = sfmcpp.circle_scene(6, 30, camera_model="calibrated", pixel_sigma_px=0.0, seed=1)
    errors = {}
    for loss in ("squared", "cauchy"):
        problem = truth.copy()
        group = positions(problem, truth, weight=1e4, loss=loss)
        assert group.values is not None
        group.values[2] += [0.5, 0.5, 0.0]
        sfmcpp.solve(problem, constraints=[group], method=method, line_search=search, max_iterations=300)
        errors[loss] = np.abs(problem.centres - truth.centres).max()
    assert errors["squared"] > 0.05
    assert errors["cauchy"] < 0.1 * errors["squared"]


def test_cameras_without_images_are_placed_by_what_sensors_say() -> None:
    truth = sfmcpp.circle_scene(6, 30, camera_model="calibrated", pixel_sigma_px=0.0, seed=1)
    seen = ~np.isin(truth.camera_index, [2, 3])
    problem = replace(
        truth,
        cameras=truth.cameras.copy(),
        points=truth.points.copy(),
        camera_index=truth.camera_index[seen],
        point_index=truth.point_index[seen],
        pixels=truth.pixels[seen],
    )
    problem.fixed_cameras[0] = True
    problem.cameras[2:4, :, 3] += 0.5
    values = [relative_pose(truth, i, i + 1) for i in range(1, 4)]
    group = ConstraintGroup("displacement-pose", [[1, 2], [2, 3], [3, 4]], values, 1e4)
    summary = sfmcpp.solve(problem, constraints=[group], function_tolerance=1e-14, max_iterations=100)
    assert not any("no observations" in warning for warning in summary.warnings)
    np.testing.assert_allclose(problem.centres, truth.centres, atol=1e-6)
    problem.cameras[2:4, :, 3] += 0.5
    distances = ConstraintGroup("scale", [[1, 2], [2, 3], [3, 4]], [1.0, 1.0, 1.0])
    with pytest.raises(sfmcpp.InvalidArgument, match=r"'scale'\]\[0\].cameras: camera 2 has no observ"):
        sfmcpp.solve(problem, constraints=[distances])


def relative_pose(problem: Problem, i: int, j: int) -> Array:
    return np.asarray((np.linalg.inv(matrix(problem.cameras[i])) @ matrix(problem.cameras[j]))[:3])


def test_a_window_is_held_by_displacements_to_fixed_cameras() -> None:
    truth = sfmcpp.circle_scene(6, 30, camera_model="calibrated", pixel_sigma_px=0.0, seed=1)
    problem = scene("calibrated")
    problem.fixed_cameras[:] = [True, True, True, False, False, False]
    problem.cameras[:3] = truth.cameras[:3]
    fixed = problem.cameras[:3].copy()
    pairs = np.array([[2, 3], [3, 4], [4, 5]])
    group = ConstraintGroup(
        "displacement-translation", pairs, truth.centres[pairs[:, 1]] - truth.centres[pairs[:, 0]], 1e12
    )
    sfmcpp.solve(problem, constraints=[group], function_tolerance=1e-14, max_iterations=200)
    np.testing.assert_array_equal(problem.cameras[:3], fixed)
    np.testing.assert_allclose(problem.centres, truth.centres, atol=1e-4)


def test_a_weight_of_zero_gives_the_same_bits_as_no_constraint() -> None:
    without, group, member = scene(), scene(), scene()
    sfmcpp.solve(without)
    gps = positions(group, without, weight=0.0)
    summary = sfmcpp.solve(group, constraints=[gps])
    assert summary.constraint_costs == {"gps": (0.0, 0.0)}
    sfmcpp.solve(member, constraints=[positions(member, without, member_weights=np.zeros(6))])
    for problem in (group, member):
        np.testing.assert_array_equal(problem.cameras, without.cameras)
        np.testing.assert_array_equal(problem.points, without.points)


def test_changing_the_weight_of_a_group_changes_the_next_solve() -> None:
    truth = sfmcpp.circle_scene(6, 30, camera_model="calibrated", seed=1)
    start = scene("calibrated")
    gps = positions(start, truth, weight=1.0)
    gps.values[3] += 0.5  # type: ignore[index]
    distances = []
    for weight in (1.0, 1e7, 1e9):
        gps.weight = weight
        problem = start.copy()
        sfmcpp.solve(problem, constraints=[gps], max_iterations=200, function_tolerance=1e-12)
        distances.append(np.linalg.norm(problem.centres[3] - gps.values[3]))  # type: ignore[index]
    assert distances[0] > 10 * distances[1] > 100 * distances[2]


def test_summary_tells_the_cost_of_each_group_and_survives_pickle() -> None:
    problem = scene()
    groups = [random_group(problem, "position", name="gps"), random_group(problem, "scale", name="odometer")]
    summary = sfmcpp.solve(problem, constraints=groups)
    assert summary.constraint_costs.keys() == {"gps", "odometer"}
    total = sum(final for _, final in summary.constraint_costs.values())
    assert summary.final_cost == pytest.approx(sfmcpp.cost(problem) + total, rel=1e-12)
    assert "cost of 'gps'" in str(summary)
    assert pickle.loads(pickle.dumps(summary)).constraint_costs == summary.constraint_costs
    assert summary.to_dict()["constraint_costs"] == summary.constraint_costs


@pytest.mark.parametrize("search", ["g-als", "t-als", "exact", "soft", "backtracking"])
def test_line_searches_come_to_the_same_minimum(search: str) -> None:
    truth = sfmcpp.circle_scene(6, 30, camera_model="calibrated", seed=1)
    costs = []
    for line_search in ("none", search):
        problem = scene("calibrated")
        gps = positions(problem, truth, weight=50.0)
        options = {"function_tolerance": 1e-13, "max_iterations": 200}
        costs.append(sfmcpp.solve(problem, constraints=[gps], line_search=line_search, **options).final_cost)
    assert costs[1] == pytest.approx(costs[0], rel=1e-7)


def test_a_group_without_members_changes_nothing() -> None:
    problem, reference = scene(), scene()
    empty = [
        ConstraintGroup(kind, [], [] if kind == "scale" else None, name=kind)
        for kind in ("scale", "smoothing")
    ]
    assert sfmcpp.solve(problem, constraints=empty).constraint_costs == {"scale": (0, 0), "smoothing": (0, 0)}
    sfmcpp.solve(reference)
    np.testing.assert_array_equal(problem.cameras, reference.cameras)
