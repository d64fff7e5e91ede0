"""The variance factor: its formula without robust loss, and covariances times it beside real errors."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

import sfmcpp
from sfmcpp import ConstraintGroup, Problem

SIGMA_PX = 0.7
# Of normal errors, 95 % efficiency; beyond it "truncated" lets go.
SCALES = {"squared": 1.0, "huber": 1.345, "cauchy": 2.385, "tukey": 4.685, "truncated": 4.0}


def noisy(truth: Problem, outliers: float, seed: int) -> Problem:
    """Normal errors, and a share of gross ones; six fixed points hold the world."""
    rng, problem = np.random.default_rng(seed), truth.copy()
    problem.pixels += rng.normal(0, SIGMA_PX, problem.pixels.shape)
    wrong = rng.random(problem.num_observations) < outliers
    problem.pixels[wrong] += rng.uniform(-60, 60, (np.count_nonzero(wrong), 2))
    problem.sigma_px = np.full(problem.num_observations, SIGMA_PX)
    problem.fixed_points[:6] = True
    return problem


@pytest.mark.parametrize(
    ("loss", "outliers"), [(loss, 0.0) for loss in SCALES] + [(loss, 0.2) for loss in list(SCALES)[1:]]
)
def test_errors_of_points_are_those_of_covariances_times_it(loss: str, outliers: float) -> None:
    truth, ratios = sfmcpp.circle_scene(8, 60, pixel_sigma_px=0.0, seed=1), []
    for seed in range(60):
        problem = noisy(truth, outliers, seed)
        sfmcpp.solve(problem, loss=loss, loss_scale_px=SCALES[loss], function_tolerance=1e-12)
        model = sfmcpp.linearize(problem, loss=loss, loss_scale_px=SCALES[loss])
        covariances = model.covariance(points="all").points[6:] * model.variance_factor
        errors = (problem.points - truth.points)[6:]
        squares = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(covariances), errors)
        ratios.append(np.median(squares) / chi2.median(3))
    assert np.mean(ratios) == pytest.approx(1, abs=0.15)


def test_numbers_of_groups_with_weight_count_as_many_as_are_independent() -> None:
    problem = noisy(sfmcpp.circle_scene(8, 60, pixel_sigma_px=0.0, seed=1), 0.0, 0)
    cameras = np.arange(8)
    turned = ConstraintGroup("orientation", cameras, problem.rotations.copy(), sigma=0.01)
    placed = ConstraintGroup("position", cameras, problem.centres + 0.01, sigma=0.05)
    idle = ConstraintGroup("position", cameras, problem.centres + 1.0, weight=0.0, name="idle")
    groups = [turned, placed, idle]
    sfmcpp.solve(problem, constraints=groups)
    model = sfmcpp.linearize(problem, constraints=groups)
    squares = np.sum(model.residuals**2) + sum(rows.weight * rows.squared_error for rows in model.groups)
    numbers = 2 * problem.num_observations + 3 * 8 + 3 * 8
    assert model.variance_factor == pytest.approx(squares / (numbers - model.num_determined), rel=1e-12)


def test_it_is_no_number_without_redundancy() -> None:
    problem = sfmcpp.circle_scene(2, 5, pixel_sigma_px=1.0, seed=3)
    sfmcpp.solve(problem)
    model = sfmcpp.linearize(problem)
    assert model.num_determined >= 2 * problem.num_observations
    assert np.isnan(model.variance_factor)
