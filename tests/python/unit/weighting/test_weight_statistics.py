"""Redundancies, likelihoods and left-out errors against dense matrices and plain refits."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

import sfmcpp
from sfmcpp import ConstraintGroup, InvalidArgument, Problem
from sfmcpp.weighting import WEIGHT_METHODS
from sfmcpp.weighting.fits import WeightFit, WeightFits
from sfmcpp.weighting.statistics import FitStatistics
from sfmcpp.weighting.trials import FOLDS, fold_of_observation, score_of
from weight_helpers import Array, dense_jacobian, dense_rows, fitted, gps, odometer, small_scene, street

SIGMA_M = 0.05


def without(problem: Problem, left_out: Array) -> Problem:
    keep = np.setdiff1d(np.arange(len(problem.pixels)), left_out)
    parts = {name: getattr(problem, name)[keep] for name in ("camera_index", "point_index", "pixels")}
    return Problem(
        problem.camera_model, problem.cameras.copy(), problem.intrinsics, problem.points.copy(), **parts
    )


def refitted_residuals(fit: WeightFit, group: ConstraintGroup, left_out: Array, steps: int = 50) -> Array:
    """Residuals of left-out observations after a plain fit to the others."""
    others = without(fit.problem, left_out)
    sfmcpp.solve(others, constraints=[group], function_tolerance=1e-12, max_iterations=steps)
    whole = fit.problem.copy()
    whole.cameras[:], whole.points[:] = others.cameras, others.points
    return np.asarray(sfmcpp.residuals(whole)[left_out])


@pytest.fixture(scope="module")
def at_truth() -> tuple[WeightFits, WeightFit, Array, ConstraintGroup]:
    problem, truth = small_scene(2)
    group = gps(truth, SIGMA_M, weight=3 / SIGMA_M**2)
    weights = np.array([group.weight])
    return *fitted(problem, [group], weights), weights, group


def test_redundancies_add_up_to_the_degrees_of_freedom() -> None:
    problem, truth = small_scene(1)
    groups = [gps(truth, SIGMA_M), odometer(truth, 0.01)]
    weights = np.array([3 / SIGMA_M**2, 1e4])
    fits, fit = fitted(problem, groups, weights)
    found = FitStatistics(fits, fit.problem, weights).redundancy
    measured = 2 * len(problem.pixels) + 3 * 6 + 5
    unknown = 6 * 6 + 3 * problem.num_points
    assert found.images + found.groups.sum() == pytest.approx(measured - unknown, abs=1e-3)
    assert (found.groups > 0).all()
    assert found.groups[0] < 18


def test_the_redundancy_of_a_group_is_that_of_the_dense_hat_matrix(
    at_truth: tuple[WeightFits, WeightFit, Array, ConstraintGroup],
) -> None:
    fits, fit, weights, group = at_truth
    jacobian, (_, rows) = dense_jacobian(fit.problem), dense_rows(group, fit.problem)
    rows = np.sqrt(weights[0]) * rows
    hat = rows @ np.linalg.solve(jacobian.T @ jacobian + rows.T @ rows, rows.T)
    found = FitStatistics(fits, fit.problem, weights)
    np.testing.assert_allclose(found.hats[0], hat, atol=1e-5)
    assert found.redundancy.groups[0] == pytest.approx(18 - np.trace(hat), abs=1e-4)


@pytest.mark.parametrize("factor", [0.1, 4.0])
def test_the_minimum_of_the_model_is_nearly_that_of_a_fit_at_another_weight(
    at_truth: tuple[WeightFits, WeightFit, Array, ConstraintGroup], factor: float
) -> None:
    fits, fit, weights, _ = at_truth
    found = FitStatistics(fits, fit.problem, factor * weights).fit
    expected = fits.fit(factor * weights, fit.problem)
    assert abs(expected.images - fit.images) > 2
    assert found.images == pytest.approx(expected.images, rel=1e-4)
    np.testing.assert_allclose(found.errors, expected.errors, rtol=1e-3)


def test_of_a_large_problem_the_images_lose_no_freedom_to_where_the_world_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    problem, truth = small_scene(1)
    weights = np.array([1e-2])  # nothing beside the images, but enough to place the world
    fits, fit = fitted(problem, [gps(truth, SIGMA_M)], weights)
    small = FitStatistics(fits, fit.problem, weights, settled=True)
    expected = small.image_sigma
    monkeypatch.setattr("sfmcpp.weighting.statistics.MAX_COLUMNS", 1)
    large = FitStatistics(fits, fit.problem, weights)
    assert large.too_large
    assert large.image_sigma == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("factor", [0.02, 1.0, 5.0])
def test_the_best_factor_maximises_the_dense_restricted_likelihood(factor: float) -> None:
    problem, truth = small_scene(3)
    group = gps(truth, SIGMA_M, seed=3)
    weights = np.array([factor * 3 / SIGMA_M**2])
    fits, fit = fitted(problem, [group], weights)
    statistics = FitStatistics(fits, fit.problem, weights)
    residuals = sfmcpp.residuals(fit.problem).ravel()
    jacobian, (errors, rows) = dense_jacobian(fit.problem), dense_rows(group, fit.problem)

    def minus_twice_log_likelihood(log_factor: float) -> float:
        weight = weights[0] * np.exp(log_factor)
        normal = jacobian.T @ jacobian + weight * rows.T @ rows
        step = -np.linalg.solve(normal, jacobian.T @ residuals + weight * rows.T @ errors)
        images, sensor = residuals + jacobian @ step, errors + rows @ step
        cost = (images @ images + weight * sensor @ sensor) / statistics.image_sigma**2
        numbers = len(errors) - 1  # the prior is proportional to σ
        return float(cost + np.linalg.slogdet(normal)[1] - numbers * np.log(weight))

    best = minimize_scalar(minus_twice_log_likelihood, bounds=(-5, 5), method="bounded").x
    assert np.log(statistics.best_factor(0)) == pytest.approx(best, abs=5e-3)


def test_left_out_errors_in_closed_form_are_those_of_refits(
    at_truth: tuple[WeightFits, WeightFit, Array, ConstraintGroup],
) -> None:
    fits, fit, weights, group = at_truth
    exact = np.array(
        [refitted_residuals(fit, group, np.array([o]))[0] for o in range(len(fit.problem.pixels))]
    )
    score = fits.left_out_loss((exact**2).sum(axis=1)).mean()
    assert FitStatistics(fits, fit.problem, weights).left_out_error() == pytest.approx(score, rel=0.05)


def test_folds_leave_out_four_observations_of_each_point_one_at_a_time() -> None:
    rng = np.random.default_rng(0)
    points = rng.permutation(np.repeat(np.arange(40), rng.integers(1, 12, 40)))
    folds = fold_of_observation(points.astype(np.int32))
    for point in range(40):
        mine = folds[points == point]
        left_out = np.sort(mine[mine >= 0])
        expected = range(FOLDS) if len(mine) >= FOLDS else []
        np.testing.assert_array_equal(left_out, list(expected))


def test_the_score_of_folds_is_that_of_plain_refits(
    at_truth: tuple[WeightFits, WeightFit, Array, ConstraintGroup],
) -> None:
    fits, fit, weights, group = at_truth
    folds = fold_of_observation(fit.problem.point_index)
    exact = [refitted_residuals(fit, group, np.flatnonzero(folds == f)) for f in range(FOLDS)]
    score = fits.left_out_loss((np.concatenate(exact) ** 2).sum(axis=1)).mean()
    assert score_of(WEIGHT_METHODS["k-fold"])(fits, 0, weights[None], [fit])[0] == pytest.approx(
        score, rel=1e-3
    )


def _image_sigma(problem: Problem, group: ConstraintGroup, weights: Array, **options: object) -> float:
    fits, fit = fitted(problem, [group], weights, **options)
    return FitStatistics(fits, fit.problem, weights).image_sigma


def test_image_sigma_is_found_with_and_without_outliers() -> None:
    truth = sfmcpp.circle_scene(8, 60, pixel_sigma_px=2.0, seed=4)
    problem = sfmcpp.perturb(truth, position_sigma_m=0.02, seed=1)
    weights = np.array([3 / SIGMA_M**2])
    group = gps(truth, SIGMA_M)
    sigma = _image_sigma(problem, group, weights)
    assert sigma == pytest.approx(2.0, rel=0.07)
    spoiled, _ = sfmcpp.add_outliers(problem, 0.05, seed=2)
    options = {"loss": "tukey", "loss_scale_px": 4.6851 * 2}
    robust = _image_sigma(spoiled, group, weights, **options)
    assert robust == pytest.approx(2.0, rel=0.15)


@pytest.mark.parametrize(("weight", "told"), [(3, "weight = 3"), ({"gps": None}, r"weight\['gps'\] = None")])
def test_what_is_no_method_is_refused_by_name(weight: Any, told: str) -> None:
    problem, truth = small_scene(0)
    with pytest.raises(InvalidArgument, match=told):
        sfmcpp.solve(problem, constraints=[gps(truth, 0.1)], weight=weight)


def test_a_group_without_weight_does_not_change_the_weight_of_another() -> None:
    start, truth = street()
    alone = gps(truth, 0.1)
    sfmcpp.solve(start.copy(), constraints=[alone], weight={"gps": "variance"})
    beside, idle = gps(truth, 0.1), odometer(truth, 0.02, weight=0.0)
    sfmcpp.solve(start.copy(), constraints=[beside, idle], weight={"gps": "variance"})
    assert idle.weight == 0.0
    assert beside.weight == pytest.approx(alone.weight, rel=0.02)


@pytest.mark.parametrize(("method", "views"), [("loo-approx", 2), ("k-fold", 3)])
def test_points_of_too_few_views_leave_nothing_to_validate_by(method: str, views: int) -> None:
    truth = sfmcpp.circle_scene(8, 60, pixel_sigma_px=1.0, seed=3)
    order = np.argsort(truth.point_index, kind="stable")
    ordered = truth.point_index[order]
    place = np.arange(len(order)) - np.searchsorted(ordered, ordered)
    few = truth.with_observations(order[(place + 3 * ordered) % np.bincount(ordered)[ordered] < views])
    with pytest.raises(InvalidArgument, match=f"weight = '{method}': no point has {views + 1} observations"):
        sfmcpp.solve(few, constraints=[gps(truth, 0.1)], weight=method)
