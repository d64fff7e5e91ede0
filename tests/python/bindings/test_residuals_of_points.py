"""Own residuals of points: images copied as a function, minima against SciPy, what cannot be."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import sfmcpp
from constrained import Array, positions, scene
from projection import reference_residuals
from sfmcpp import Problem, ResidualGroup

LINEAR_SOLVERS = ("dense", "sparse", "iterative")


def skew(x: Array) -> Array:
    zero = np.zeros(len(x))
    rows = [[zero, -x[:, 2], x[:, 1]], [x[:, 2], zero, -x[:, 0]], [-x[:, 1], x[:, 0], zero]]
    return np.moveaxis(np.array(rows), 2, 0)


def images(problem: Problem, chosen: Array, split: bool = False, **more: Any) -> list[ResidualGroup]:
    """Chosen observations as functions of poses and points; `split`: u and v in a group each."""
    cameras, points = problem.camera_index[chosen], problem.point_index[chosen]
    f, aspect, cx, cy = (
        problem.intrinsics[problem.intrinsics_index[cameras], problem.intrinsic_names.index(name)]
        for name in ("f", "aspect", "cx", "cy")
    )
    pixels = problem.pixels[chosen]

    def residuals(poses: Array, places: Array) -> tuple[Array, Array, Array]:
        x = np.einsum("nji,nj->ni", poses[:, :, :3], places - poses[:, :, 3])
        u, v, zero = f * x[:, 0] / x[:, 2], aspect * f * x[:, 1] / x[:, 2], np.zeros(len(x))
        by_x = np.stack(
            [
                np.stack([f / x[:, 2], zero, -u / x[:, 2]], axis=1),
                np.stack([zero, aspect * f / x[:, 2], -v / x[:, 2]], axis=1),
            ],
            axis=1,
        )
        by_place = by_x @ np.swapaxes(poses[:, :, :3], 1, 2)
        by_pose = np.concatenate([by_x @ skew(x), -by_place], axis=2)
        return pixels - np.stack([u + cx, v + cy], axis=1), -by_pose, -by_place

    def only(k: int) -> Callable[[Array, Array], tuple[Array, ...]]:
        return lambda *state: tuple(each[:, k : k + 1] for each in residuals(*state))

    functions = {"u": only(0), "v": only(1)} if split else {"images": residuals}
    return [
        ResidualGroup(function, cameras, points=points, name=name, **more)
        for name, function in functions.items()
    ]


def fixed_intrinsics(**options: Any) -> Problem:
    return scene(**options).set_free_intrinsics()


def without(problem: Problem, chosen: Array) -> Problem:
    kept = np.ones(problem.num_observations, dtype=bool)
    kept[chosen] = False
    return problem.with_observations(kept).copy()


CHOSEN = np.arange(0, 180, 5)


OPTIONS: list[dict[str, Any]] = [
    {"linear_solver": "dense"},
    {"linear_solver": "sparse"},
    {"linear_solver": "iterative", "pcg_tolerance": 1e-12},
    *({"method": name} for name in ("lm", "dog-leg", "gauss-newton", "gradient-descent", "alternation")),
    *({"line_search": name} for name in ("backtracking", "exact", "soft")),
    {"precision": "single", "linear_solver": "sparse"},
    {"loss": "huber", "loss_scale_px": 2.0},
]


# A loss of u and v apart is another loss.
@pytest.mark.parametrize(
    ("options", "split"),
    [(options, split) for options in OPTIONS for split in (False, True) if not (split and "loss" in options)],
    ids=str,
)
def test_images_as_functions_take_the_iterations_of_images(options: dict[str, Any], split: bool) -> None:
    whole = fixed_intrinsics()
    parts = without(whole, CHOSEN)
    loss = {"loss": "huber", "loss_scale": 2.0} if "loss" in options else {}
    # Roundings differ, and matter less with more damping.
    damped = {} if "method" in options else {"initial_damping": 1e-4}
    options = {"point_steps": "whole", "acceleration": "none", "max_iterations": 12} | damped | options
    expected = sfmcpp.solve(whole, **options)
    found = sfmcpp.solve(parts, constraints=images(fixed_intrinsics(), CHOSEN, split, **loss), **options)
    assert len(expected.iterations) > 3
    np.testing.assert_allclose(found.history()["cost"], expected.history()["cost"], rtol=1e-6)
    np.testing.assert_allclose(parts.points, whole.points, atol=1e-5)
    if options.get("precision") != "single":
        np.testing.assert_allclose(found.history()["cost"], expected.history()["cost"], rtol=1e-10)
        np.testing.assert_allclose(parts.points, whole.points, atol=1e-8)


@pytest.mark.parametrize("linear_solver", LINEAR_SOLVERS)
def test_cameras_of_a_rig_and_a_single_point_see_as_functions_what_images_see(linear_solver: str) -> None:
    truth = sfmcpp.rig_walk_scene(num_cameras=12, num_points=200, length_m=4.0, seed=3)
    whole = sfmcpp.perturb(truth, point_sigma_m=0.03, position_sigma_m=0.03, seed=1).set_free_intrinsics()
    assert whole.rigs is not None
    whole.fixed_cameras[whole.rigs.frame_of_camera == 0] = True
    once = np.flatnonzero(np.bincount(whole.point_index, minlength=200)[whole.point_index] == 2)[:1]
    chosen = np.union1d(np.arange(0, whole.num_observations, 4), once)
    parts = without(whole, chosen)
    own = images(whole, chosen)
    options = {"linear_solver": linear_solver, "function_tolerance": 1e-13, "max_iterations": 100}
    expected = sfmcpp.solve(whole, **options)
    found = sfmcpp.solve(parts, constraints=own, **options)
    assert found.final_cost == pytest.approx(expected.final_cost, rel=1e-8)
    np.testing.assert_allclose(parts.cameras, whole.cameras, atol=1e-4)


def lidar(truth: Problem, chosen: Array) -> ResidualGroup:
    """Three coordinates in the frame of the camera, by differences: three rows beside an image."""
    cameras, points = truth.camera_index[chosen], truth.point_index[chosen]
    noise = np.random.default_rng(4).normal(0, 0.05, (len(chosen), 3))

    def place(poses: Array, places: Array) -> Array:
        return np.einsum("nji,nj->ni", poses[:, :, :3], places - poses[:, :, 3])

    measured = place(truth.cameras[cameras], truth.points[points]) + noise
    return ResidualGroup(
        lambda *state: (place(*state) - measured) / 0.05, cameras, points=points, name="lidar"
    )


def on_a_plane(chosen: Array) -> ResidualGroup:
    return ResidualGroup(lambda x: (x[:, 2:] + 0.1 * x[:, :1] - 0.3) / 0.2, points=chosen, name="plane")


def test_minimum_with_residuals_of_points_equals_that_of_scipy() -> None:
    problem = scene("calibrated")
    problem.fixed_cameras[0] = True
    groups = [lidar(sfmcpp.circle_scene(6, 30, seed=1), np.arange(0, 40, 5)), on_a_plane(np.arange(9))]
    start = problem.copy()

    def moved(x: Array) -> Problem:
        other = start.copy()
        other.cameras[1:, :, :3] = (
            start.rotations[1:] @ Rotation.from_rotvec(x[:15].reshape(5, 3)).as_matrix()
        )
        other.cameras[1:, :, 3] += x[15:30].reshape(5, 3)
        other.points += x[30:].reshape(-1, 3)
        return other

    def own(at: Problem) -> list[Array]:
        places, cameras = at.points[groups[0].points], at.cameras[groups[0].cameras]
        return [groups[0].function(cameras, places), groups[1].function(at.points[:9])]

    def all_residuals(x: Array) -> Array:
        at = moved(x)
        return np.concatenate([reference_residuals(at).ravel(), *(r.ravel() for r in own(at))])

    expected = least_squares(all_residuals, np.zeros(30 + start.points.size), xtol=1e-14, ftol=1e-14)
    for linear_solver in LINEAR_SOLVERS:
        solved = start.copy()
        summary = sfmcpp.solve(
            solved, constraints=groups, linear_solver=linear_solver, function_tolerance=1e-15
        )
        assert summary.final_cost == pytest.approx(expected.cost, rel=1e-9)
        assert summary.constraint_costs["plane"][1] == pytest.approx(0.5 * np.sum(own(solved)[1] ** 2))
        np.testing.assert_allclose(solved.points, moved(expected.x).points, atol=1e-4)
    assert [np.abs(r).max() > 0.1 for r in own(solved)] == [True, True]  # they disagree with the images


@pytest.mark.parametrize("linear_solver", LINEAR_SOLVERS)
def test_bits_are_the_same_for_any_number_of_threads(linear_solver: str) -> None:
    truth = sfmcpp.circle_scene(12, 2000, seed=2)
    groups = [lidar(truth, np.arange(0, truth.num_observations, 7)), on_a_plane(np.arange(500))]
    results = []
    for threads in (1, 2, 3):
        problem = sfmcpp.perturb(truth, point_sigma_m=0.1, position_sigma_m=0.1, seed=3)
        sfmcpp.solve(
            problem, constraints=groups, threads=threads, linear_solver=linear_solver, max_iterations=4
        )
        results.append(problem)
    for other in results[1:]:
        assert np.array_equal(other.cameras, results[0].cameras)
        assert np.array_equal(other.points, results[0].points)


def test_a_point_without_images_goes_where_its_residuals_say() -> None:
    truth = sfmcpp.circle_scene(6, 30, seed=1)
    kept = truth.point_index != 7
    problem = truth.with_observations(kept)
    problem.points[7] += 1.0
    group = lidar(truth, np.flatnonzero(truth.point_index == 7)[:1])
    summary = sfmcpp.solve(problem, constraints=[group])
    assert np.linalg.norm(problem.points[7] - truth.points[7]) < 0.3
    assert summary.constraint_costs["lidar"][1] < 1e-8
    assert not any("point 7" in warning for warning in summary.warnings)
    problem.fixed_points[7] = True
    before = problem.points[7].copy()
    sfmcpp.solve(problem, constraints=[group])
    assert np.array_equal(problem.points[7], before)


def test_known_points_fix_the_gauge_where_there_is_one() -> None:
    """Gauss–Newton holds what nothing else does: with known points nothing, and both end alike."""
    truth = sfmcpp.circle_scene(6, 30, seed=1)
    known = ResidualGroup(lambda x: (x - 1.5 * truth.points[:6]) / 0.01, points=np.arange(6))
    solved = []
    for method in ("gauss-newton", "lm"):
        problem = truth.copy()
        problem.points *= 1.45
        problem.cameras[:, :, 3] *= 1.45
        summary = sfmcpp.solve(problem, constraints=[known], method=method, function_tolerance=1e-14)
        assert summary.final_cost < 1e3
        solved.append(problem)
    np.testing.assert_allclose(solved[0].points, solved[1].points, atol=1e-5)
    np.testing.assert_allclose(solved[0].points[:6], 1.5 * truth.points[:6], atol=0.02)


def test_a_robust_group_lets_go_of_a_wrong_point() -> None:
    truth = sfmcpp.circle_scene(6, 30, seed=1)
    places = truth.points + np.random.default_rng(0).normal(0, 0.01, truth.points.shape)
    places[3] += 5.0
    errors = {}
    for loss in ("squared", "cauchy"):
        problem = truth.copy()
        group = ResidualGroup(lambda x: (x - places) / 0.01, points=np.arange(30), loss=loss)
        sfmcpp.solve(problem, constraints=[group])
        errors[loss] = np.abs(problem.points - truth.points).max()
    assert errors["cauchy"] < 0.05 < errors["squared"]


@pytest.mark.parametrize("gauge", ["free", "fixed"])
def test_the_linear_model_is_that_of_images(gauge: Any) -> None:
    whole = fixed_intrinsics()
    sfmcpp.solve(whole, function_tolerance=1e-14)
    own = [*images(whole, CHOSEN), on_a_plane(np.arange(9))]
    plane, split = [on_a_plane(np.arange(9))], without(whole, CHOSEN)
    expected = sfmcpp.linearize(whole, constraints=plane, gauge=gauge)
    found = sfmcpp.linearize(split, constraints=own, gauge=gauge)
    assert found.cost == pytest.approx(expected.cost)
    np.testing.assert_allclose(
        found.normal_matrix().toarray(), expected.normal_matrix().toarray(), rtol=1e-9, atol=1e-3
    )
    np.testing.assert_allclose(found.gradient(), expected.gradient(), atol=1e-4)
    for which in ("cameras", "points"):
        first, second = (
            getattr(model.covariance(cameras="all", points="all"), which) for model in (found, expected)
        )
        np.testing.assert_allclose(first, second, rtol=1e-5, atol=1e-12)
    kept = np.setdiff1d(np.arange(whole.num_observations), CHOSEN)
    np.testing.assert_allclose(found.leverages(), expected.leverages()[kept], rtol=1e-6, atol=1e-9)
    assert found.num_determined == expected.num_determined
    step = found.step()
    np.testing.assert_allclose(step.problem.points, expected.step().problem.points, atol=1e-7)
    np.testing.assert_allclose(step.errors[1], expected.step().errors[0], atol=1e-7)


def test_hat_of_residuals_on_points_equals_the_dense_one() -> None:
    problem = scene("calibrated")
    model = sfmcpp.linearize(
        problem, constraints=[on_a_plane(np.arange(9)), positions(problem, problem.copy())]
    )
    rows = model.groups[0].jacobian().toarray()
    dense = rows @ np.linalg.pinv(model.normal_matrix().toarray(), rcond=1e-13, hermitian=True) @ rows.T
    np.testing.assert_allclose(model.hat_matrix(0), dense, atol=1e-8)


def test_derivatives_by_points_are_checked() -> None:
    problem, sign = scene(), -1.0

    def height(places: Array) -> tuple[Array, Array]:
        return places[:, 2:] - 1.0, np.tile([[[0.0, 0.0, sign]]], (len(places), 1, 1))

    group = ResidualGroup(height, points=np.arange(5))
    assert group.derivative_error(problem) == pytest.approx(2.0)
    assert any(
        "'height'" in w and "are off" in w for w in sfmcpp.solve(scene(), constraints=[group]).warnings
    )
    sign = 1.0
    assert group.derivative_error(problem) < 1e-6
    own = images(problem, CHOSEN)[0]
    assert own.derivative_error(problem) < 1e-6
    given = own.evaluate(problem.cameras[own.cameras][:, None], problem.points[own.points])
    own.function = (lambda function: lambda *state: function(*state)[0])(own.function)
    found = own.evaluate(problem.cameras[own.cameras][:, None], problem.points[own.points])
    np.testing.assert_allclose(found.by_point, given.by_point, rtol=1e-6, atol=1e-4)
    np.testing.assert_allclose(found.by_poses, given.by_poses, rtol=1e-6, atol=1e-4)


def test_what_a_group_of_points_cannot_be_is_refused_by_name() -> None:
    def own(*state: Array) -> Array:
        return np.zeros((len(state[0]), 1))

    def refused(message: str, **fields: Any) -> None:
        with pytest.raises(sfmcpp.InvalidArgument, match=message):
            sfmcpp.solve(scene(), constraints=[ResidualGroup(own, **fields)])

    refused(r"'own'\].cameras: must be given, or points")
    refused(r"'own'\].points: must be from 0 to 29", points=[0, 30])
    refused(r"'own'\].points: float64 \(1,\), must be \(any,\) whole numbers", points=[0.5])
    refused(r"'own'\].cameras: shape \(2,\), must be \(3,\)", cameras=[0, 1], points=[0, 1, 2])
    refused(r"'own'\].cameras: shape \(1, 2\), must be \(1,\)", cameras=[[0, 1]], points=[0])
    half = ResidualGroup(lambda poses, x: (x, x), [0], points=[0], name="own")
    with pytest.raises(sfmcpp.InvalidArgument, match="1 arrays of derivatives, must be none or 2"):
        sfmcpp.solve(scene(), constraints=[half])
    with pytest.raises(sfmcpp.InvalidArgument, match="camera_model = 'projective'"):
        sfmcpp.solve(sfmcpp.as_projective(scene()), constraints=[ResidualGroup(own, points=[0])])
