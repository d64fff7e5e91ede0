"""The variance of observations, from the residuals of an adjustment."""

from __future__ import annotations

import numpy as np
import pytest

import sfmcpp
from sfmcpp.sfm.fit_statistics import linear_model, pixel_variance


def adjusted(seed: int) -> sfmcpp.Problem:
    problem = sfmcpp.circle_scene(5, 12, pixel_sigma_px=1.0, seed=seed)
    sfmcpp.solve(problem, max_iterations=50, function_tolerance=1e-10)
    return problem


def test_of_few_observations_it_is_that_of_their_noise() -> None:
    found = [pixel_variance(linear_model(adjusted(seed), [], {})) for seed in range(60)]
    assert abs(np.mean(found) - 1) < 2.5 * np.std(found) / np.sqrt(len(found))


def test_it_does_not_depend_on_the_gauge() -> None:
    problem = adjusted(0)
    free, fixed = (pixel_variance(linear_model(problem, [], {"gauge": gauge})) for gauge in ("free", "fixed"))
    assert free == pytest.approx(fixed, rel=1e-12)
