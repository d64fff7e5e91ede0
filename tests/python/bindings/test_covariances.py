"""Observations with covariances, as Python sees them: against NumPy and SciPy, and for what they are."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import sfmcpp
from projection import minimum_by_scipy, reference_residuals
from sfmcpp import ConstraintGroup, InvalidArgument, Problem
from sfmcpp.ba import LINE_SEARCHES, METHODS

Array = NDArray[np.float64]

SEEDS = 8


def turned(angle: Array | float) -> Array:
    """Rotations (…, 2, 2) of the axes of an image."""
    c, s = np.cos(angle), np.sin(angle)
    return np.moveaxis(np.array([[c, -s], [s, c]]), [0, 1], [-2, -1])


def ellipses(sigmas: Array, angle: Array) -> Array:
    """Covariances (M, 2, 2) with standard deviations (M, 2) along axes turned by (M,) angles."""
    axes = turned(angle) * sigmas[:, None, :]
    return np.asarray(axes @ np.swapaxes(axes, 1, 2))


def random_covariances(count: int, seed: int) -> Array:
    rng = np.random.default_rng(seed)
    return ellipses(rng.uniform(0.3, 3.0, (count, 2)), rng.uniform(0, np.pi, count))


def whitening(covariances: Array) -> Array:
    """L (M, 2, 2), lower triangular, with LᵀL = Σ⁻¹."""
    return np.linalg.inv(np.linalg.cholesky(covariances))


def whitened_residuals(problem: Problem) -> Array:
    """(M, 2) of an independent projection."""
    assert problem.covariance_px2 is not None
    plain = reference_residuals(replace(problem, covariance_px2=None))
    return np.einsum("mij,mj->mi", whitening(problem.covariance_px2), plain)


def scene(camera_model: str = "calibrated", cameras: int = 6, points: int = 30, seed: int = 1) -> Problem:
    """A start with a pixel of noise and a covariance for every observation."""
    truth = sfmcpp.circle_scene(cameras, points, camera_model=camera_model, pixel_sigma_px=1.0, seed=seed)
    start = sfmcpp.perturb(truth, point_sigma_m=0.1, position_sigma_m=0.1, rotation_sigma_deg=1.0, seed=seed)
    return replace(start, covariance_px2=random_covariances(start.num_observations, seed))


def arrays_of(problem: Problem) -> tuple[Array, ...]:
    return problem.cameras, problem.intrinsics, problem.points


@pytest.mark.parametrize("model", ["calibrated", "perspective", "bal"])
def test_residuals_are_those_of_an_independent_projection_whitened(model: str) -> None:
    problem = scene(model)
    np.testing.assert_allclose(sfmcpp.residuals(problem), whitened_residuals(problem), rtol=1e-10, atol=1e-9)
    assert sfmcpp.cost(problem) == pytest.approx(0.5 * np.sum(whitened_residuals(problem) ** 2), rel=1e-12)


def test_the_minimum_is_that_of_scipy_for_every_method_and_line_search() -> None:
    start = scene(cameras=4, points=15)
    expected = minimum_by_scipy(start, whitened_residuals)
    for method in METHODS:
        fast = method not in ("gradient-descent", "conjugate-gradient", "alternation")
        for search in LINE_SEARCHES:
            problem = start.copy()
            limit = 200 if fast else 30
            summary = sfmcpp.solve(
                problem, method=method, line_search=search, function_tolerance=1e-13, max_iterations=limit
            )
            least = 0.5 * np.sum(whitened_residuals(problem) ** 2)
            assert summary.final_cost == pytest.approx(least, rel=1e-12)
            assert summary.final_cost >= expected * (1 - 1e-9)
            if fast:
                assert summary.final_cost == pytest.approx(expected, rel=1e-8), (method, search)


@pytest.mark.parametrize("linear_solver", ["dense", "sparse", "iterative"])
def test_the_same_bits_for_every_number_of_threads(linear_solver: str) -> None:
    solved = []
    for threads in (1, 2, 3):
        problem = scene("bal", cameras=12, points=300)
        sfmcpp.solve(problem, threads=threads, linear_solver=linear_solver, max_iterations=6, loss="huber")
        solved.append(problem)
    for other in solved[1:]:
        for a, b in zip(arrays_of(solved[0]), arrays_of(other), strict=True):
            np.testing.assert_array_equal(a, b)


def with_images_turned(problem: Problem, angle: float) -> Problem:
    """The same cameras with the axes of their images turned about the principal point."""
    turn = turned(angle)
    centre = problem.intrinsics[0, 2:4]
    cameras = problem.cameras.copy()
    cameras[:, :, :3] = problem.rotations @ Rotation.from_rotvec([0, 0, -angle]).as_matrix()
    assert problem.covariance_px2 is not None
    return replace(
        problem,
        cameras=cameras,
        pixels=(problem.pixels - centre) @ turn.T + centre,
        covariance_px2=turn @ problem.covariance_px2 @ turn.T,
    )


@pytest.mark.parametrize("loss", ["squared", "cauchy"])
def test_turning_the_images_with_their_covariances_leaves_the_solution(loss: str) -> None:
    problem = scene()
    problem.intrinsics[:] = [500.0, 1.0, 320.0, 240.0, 0.0]
    x = np.einsum("mij,mi->mj", problem.rotations[problem.camera_index], offsets(problem))
    problem.pixels = 500.0 * x[:, :2] / x[:, 2:] + [320.0, 240.0]
    problem.pixels += np.random.default_rng(3).normal(0, 1, problem.pixels.shape)
    problem.fixed_cameras[:2] = True
    other = with_images_turned(problem, 0.7)
    left = replace(other.copy(), covariance_px2=problem.covariance_px2)
    for each in (problem, other, left):
        sfmcpp.solve(each, loss=loss, loss_scale_px=2.0, function_tolerance=1e-15, max_iterations=200)
    np.testing.assert_allclose(other.points, problem.points, atol=1e-6)
    np.testing.assert_allclose(other.centres, problem.centres, atol=1e-6)
    assert np.abs(left.points - problem.points).max() > 1e-3, "turning the images alone must matter"


def offsets(problem: Problem) -> Array:
    return np.asarray(problem.points[problem.point_index] - problem.centres[problem.camera_index])


@pytest.mark.parametrize("options", [{}, {"loss": "tukey", "line_search": "t-als"}, {"loss": "huber"}])
def test_round_covariances_have_the_bits_of_standard_deviations(options: dict[str, str]) -> None:
    sigma = np.random.default_rng(5).uniform(0.2, 3.0, 180)
    by_sigma = replace(scene(), covariance_px2=None, sigma_px=sigma)
    by_covariance = replace(scene(), covariance_px2=sigma[:, None, None] ** 2 * np.eye(2))
    np.testing.assert_array_equal(sfmcpp.residuals(by_covariance), sfmcpp.residuals(by_sigma))
    summaries = [sfmcpp.solve(p, max_iterations=8, **options) for p in (by_sigma, by_covariance)]
    assert summaries[0].final_cost.hex() == summaries[1].final_cost.hex()
    for a, b in zip(arrays_of(by_sigma), arrays_of(by_covariance), strict=True):
        np.testing.assert_array_equal(a, b)


def test_axes_of_the_image_may_differ_in_their_noise_alone() -> None:
    problem = replace(scene(), covariance_px2=np.tile(np.diag([1.0, 9.0]), (180, 1, 1)))
    np.testing.assert_allclose(sfmcpp.residuals(problem), whitened_residuals(problem), rtol=1e-10, atol=1e-9)
    summary = sfmcpp.solve(problem, function_tolerance=1e-12)
    least = 0.5 * np.sum(whitened_residuals(problem) ** 2)
    assert summary.final_cost == pytest.approx(least, rel=1e-12)


def test_the_linear_model_is_that_of_the_whitened_residuals() -> None:
    problem = scene()
    sfmcpp.solve(problem, function_tolerance=1e-10)
    model, plain = (
        sfmcpp.linearize(p, datum="all") for p in (problem, replace(problem, covariance_px2=None))
    )
    assert problem.covariance_px2 is not None
    rows = np.asarray(plain.jacobian().todense()).reshape(problem.num_observations, 2, -1)
    expected = (whitening(problem.covariance_px2) @ rows).reshape(2 * problem.num_observations, -1)
    np.testing.assert_allclose(np.asarray(model.jacobian().todense()), expected, rtol=1e-9, atol=1e-9)
    inverse = np.linalg.pinv(expected.T @ expected, rcond=1e-11, hermitian=True)
    of_observations = expected.reshape(problem.num_observations, 2, -1)
    leverages = of_observations @ inverse @ np.swapaxes(of_observations, 1, 2)
    np.testing.assert_allclose(model.leverages(), leverages, atol=1e-6)
    columns = model.camera_columns[2, :6]
    found = model.covariance(cameras=[2]).cameras[0][:6, :6]
    scale = np.sqrt(np.diag(inverse)[columns])
    error = np.abs(found - inverse[np.ix_(columns, columns)]) / np.outer(scale, scale)
    assert error.max() < 1e-5


@pytest.mark.parametrize("weight", ["variance", "loo-approx", "k-fold"])
def test_weights_of_constraints_are_chosen_beside_covariances(weight: str) -> None:
    truth = sfmcpp.circle_scene(6, 25, seed=2)
    covariances = random_covariances(truth.num_observations, 3)
    noise = np.random.default_rng(4).standard_normal((truth.num_observations, 2, 1))
    truth.pixels += (np.linalg.cholesky(covariances) @ noise)[:, :, 0]
    start = sfmcpp.perturb(truth, point_sigma_m=0.05, position_sigma_m=0.05, rotation_sigma_deg=0.3, seed=5)
    measured = truth.centres + np.random.default_rng(6).normal(0, 0.1, truth.centres.shape)
    gps = ConstraintGroup("position", np.arange(6), measured, name="gps")
    problem = replace(start, covariance_px2=covariances)
    summary = sfmcpp.solve(problem, constraints=[gps], weight=weight)
    assert 0.05 < summary.group_weights[0].sensor_sigma < 0.2


def blurred(seed: int) -> tuple[Problem, Problem]:
    """A start and the truth; every image is blurred along a direction of its own, 4 px against 0.4."""
    truth = sfmcpp.circle_scene(8, 40, seed=seed)
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0, np.pi, truth.num_cameras)[truth.camera_index]
    covariances = ellipses(np.tile([4.0, 0.4], (truth.num_observations, 1)), angle)
    seen = truth.copy()
    noise = rng.standard_normal((truth.num_observations, 2, 1))
    seen.pixels += (np.linalg.cholesky(covariances) @ noise)[:, :, 0]
    start = sfmcpp.perturb(seen, point_sigma_m=0.1, position_sigma_m=0.1, rotation_sigma_deg=1.0, seed=seed)
    start.cameras[:2], start.fixed_cameras[:2] = truth.cameras[:2], True
    return replace(start, covariance_px2=covariances), truth


def error_m(problem: Problem, truth: Problem) -> float:
    sfmcpp.solve(problem, max_iterations=200)
    return float(np.sqrt(np.mean(np.sum((problem.points - truth.points) ** 2, axis=1))))


def test_true_covariances_bring_the_points_nearer_to_the_truth_and_false_ones_do_not() -> None:
    gains, controls = [], []
    for seed in range(SEEDS):
        start, truth = blurred(seed)
        quarter = turned(np.pi / 2)
        false = replace(start.copy(), covariance_px2=quarter @ start.covariance_px2 @ quarter.T)
        without = error_m(replace(start.copy(), covariance_px2=None), truth)
        gains.append(error_m(start, truth) / without)
        controls.append(error_m(false, truth) / without)
    assert max(gains) < 1.0, gains
    assert np.median(gains) < 0.8, gains
    assert min(controls) > 1.0, controls


def test_copies_pickles_and_prints_have_them() -> None:
    problem = scene()
    for again in (problem.copy(), pickle.loads(pickle.dumps(problem))):
        np.testing.assert_array_equal(again.covariance_px2, problem.covariance_px2)
        assert again.covariance_px2 is not problem.covariance_px2
    assert repr(problem) == "Problem('calibrated': 6 cameras, 30 points, 180 observations with covariances)"


@pytest.mark.parametrize("as_mask", [False, True])
def test_a_part_of_the_observations_takes_its_accuracy_along(as_mask: bool) -> None:
    problem = scene()
    mask = np.random.default_rng(1).random(180) < 0.8
    part = problem.with_observations(mask if as_mask else np.flatnonzero(mask))
    np.testing.assert_array_equal(sfmcpp.residuals(part), sfmcpp.residuals(problem)[mask])
    by_sigma = replace(problem, covariance_px2=None, sigma_px=np.arange(1.0, 181.0))
    np.testing.assert_array_equal(by_sigma.with_observations(mask).sigma_px, np.arange(1.0, 181.0)[mask])


def test_projective_problems_keep_them() -> None:
    problem = scene()
    projective = sfmcpp.as_projective(problem)
    np.testing.assert_array_equal(projective.covariance_px2, problem.covariance_px2)
    assert sfmcpp.cost(projective) == pytest.approx(sfmcpp.cost(problem), rel=1e-9)


@pytest.mark.parametrize(
    ("values", "rule"),
    [
        ([[1, np.inf], [0, 1]], "must be finite"),
        ([[1, 0.5], [0.4, 1]], "must be symmetric"),
        ([[1, 2], [2, 1]], "must be positive definite"),
        ([[0.01, 0.03], [0.03, 0.09]], "must be positive definite"),
    ],
)
def test_the_first_bad_one_is_named(values: list[list[float]], rule: str) -> None:
    problem = scene()
    assert problem.covariance_px2 is not None
    problem.covariance_px2[[17, 44]] = values
    for refusing in (sfmcpp.check, sfmcpp.solve, sfmcpp.residuals, sfmcpp.linearize):
        with pytest.raises(InvalidArgument, match=rf"covariance_px2\[17\] = \[\[.*\]\]: {rule}"):
            refusing(problem)


def test_shapes_and_standard_deviations_beside_them_are_refused() -> None:
    problem = scene()
    with pytest.raises(InvalidArgument, match=r"covariance_px2: shape \(180, 3\), must be \(180, 2, 2\)"):
        replace(problem, covariance_px2=np.ones((180, 3)))
    with pytest.raises(InvalidArgument, match="covariance_px2: given beside sigma_px, must be one of them"):
        replace(problem, sigma_px=np.ones(180))
    problem.sigma_px = np.ones(180)
    with pytest.raises(InvalidArgument, match="covariance_px2: given beside sigma_px"):
        sfmcpp.check(problem)


def test_the_reduced_system_is_the_normal_equations_without_the_points() -> None:
    """Its solution is that of the dense system, its determinant the one that is known otherwise."""
    problem = sfmcpp.circle_scene(5, 30, pixel_sigma_px=1.0, seed=0)
    problem.fixed_cameras[:2] = True
    model = sfmcpp.linearize(sfmcpp.perturb(problem, point_sigma_m=0.05, seed=1))
    for damping in (0.0, 0.1):
        matrix, rhs = model.reduced_system(damping)
        dense = model.normal_matrix().toarray()
        dense += damping * np.diag(np.diag(dense))
        step = np.linalg.solve(dense, -model.gradient())
        np.testing.assert_allclose(np.linalg.solve(matrix, rhs), step[: len(rhs)], rtol=1e-8, atol=1e-12)
    matrix, _ = model.reduced_system()
    assert np.linalg.slogdet(matrix)[1] == pytest.approx(model.log_determinant, rel=1e-10)
    assert repr(model).startswith("LinearModel(5 cameras, 30 points: ")


@pytest.mark.parametrize("seed", range(5))
def test_the_reduced_system_is_refused_with_a_point_that_one_camera_sees(seed: int) -> None:
    """Rounding seldom leaves an exact zero in its block: the inverse was any matrix."""
    problem = sfmcpp.circle_scene(6, 20, seed=seed)
    once = problem.with_observations((problem.point_index != 4) | (problem.camera_index == 0))
    model = sfmcpp.linearize(sfmcpp.perturb(once, point_sigma_m=0.1, seed=seed))
    with pytest.raises(InvalidArgument, match=r"points\[4\]: its block is singular"):
        model.reduced_system()
    matrix, _ = model.reduced_system(1e-3)
    np.testing.assert_allclose(matrix, matrix.T, rtol=1e-9, atol=1e-9 * np.abs(matrix).max())


def test_the_gradient_is_that_of_the_cost() -> None:
    problem = sfmcpp.circle_scene(4, 20, pixel_sigma_px=1.0, seed=0)
    problem.fixed_cameras[:2] = True
    model, step = sfmcpp.linearize(problem), 1e-6
    column = int(model.point_columns[7])
    costs = []
    for sign in (1, -1):
        moved = problem.copy()
        moved.points[7, 0] += sign * step
        costs.append(sfmcpp.cost(moved))
    assert model.gradient()[column] == pytest.approx((costs[0] - costs[1]) / (2 * step), rel=1e-6)
