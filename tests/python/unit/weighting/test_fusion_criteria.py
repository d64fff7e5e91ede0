"""Each criterion against a slow reference: the thesis' equations by numeric differences of known curves."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from sfmcpp import InvalidArgument
from sfmcpp.weighting import (
    admissible_weights,
    l_curve_scores,
    lowest,
    lowest_valley,
    ltn_scores,
    running_median,
    scaled_l_curve_scores,
    weight_grid,
)

Array = NDArray[np.float64]
STEP = 1e-3


class Tikhonov:
    """``‖Ax − b‖² + λ²‖x‖²`` with a spectrum that falls fast: both objectives at the optimum of each λ."""

    def __init__(self, seed: int = 1, noise: float = 1e-3) -> None:
        rng = np.random.default_rng(seed)
        self.singular = 10.0 ** -np.linspace(0, 5, 12)
        self.truth = rng.standard_normal(12) * self.singular**0.3
        self.data = self.singular * self.truth + noise * rng.standard_normal(12)

    def solution(self, weight: float) -> Array:
        return self.singular * self.data / (self.singular**2 + weight**2)

    def rest(self, weight: float) -> float:
        return float(np.sum((self.singular * self.solution(weight) - self.data) ** 2)) + 1e-7

    def constraint(self, weight: float) -> float:
        return float(np.sum(self.solution(weight) ** 2))

    def slope(self, weight: float) -> float:
        return derivative(self.constraint, weight)

    def curve(self, weights: Array) -> tuple[Array, Array, Array]:
        rows = [[f(w) for w in weights] for f in (self.rest, self.constraint)]
        slopes = [self.slope(w) if w > 0 else 0.0 for w in weights]
        return np.array(rows[0]), np.array(rows[1]), np.array(slopes)


def derivative(f: Callable[[float], float], weight: float) -> float:
    """df / d log λ."""
    return (f(weight * np.exp(STEP)) - f(weight * np.exp(-STEP))) / (2 * STEP)


def second_derivative(f: Callable[[float], float], weight: float) -> float:
    return (f(weight * np.exp(STEP)) - 2 * f(weight) + f(weight * np.exp(-STEP))) / STEP**2


def curvature(x: Callable[[float], float], y: Callable[[float], float], weight: float) -> float:
    """Eq. 2.53 without its factor 2, which Hansen's definition has through logarithms of norms."""
    dx, dy = derivative(x, weight), derivative(y, weight)
    bend = dx * second_derivative(y, weight) - second_derivative(x, weight) * dy
    return bend / (dx**2 + dy**2) ** 1.5


WEIGHTS = np.concatenate([[0.0], np.geomspace(1e-4, 1.0, 60)])
PROBLEM = Tikhonov()
CURVE = PROBLEM.curve(WEIGHTS)


def test_l_curve_is_minus_the_curvature_of_the_logarithms() -> None:
    scores = l_curve_scores(WEIGHTS, *CURVE)
    expected = [
        -2 * curvature(lambda w: np.log(PROBLEM.rest(w)), lambda w: np.log(PROBLEM.constraint(w)), weight)
        for weight in WEIGHTS[1:]
    ]
    np.testing.assert_allclose(scores[1:], expected, rtol=1e-3, atol=1e-3)
    assert np.ptp(expected) > 1
    assert scores[0] == np.inf


def test_scaled_l_curve_is_minus_the_curvature_of_the_scaled_objectives() -> None:
    scores = scaled_l_curve_scores(WEIGHTS, *CURVE)
    width, height = np.ptp(CURVE[0]), np.ptp(CURVE[1])
    expected = [
        -curvature(lambda w: PROBLEM.rest(w) / width, lambda w: PROBLEM.constraint(w) / height, weight)
        for weight in WEIGHTS[1:]
    ]
    np.testing.assert_allclose(scores[1:], expected, rtol=2e-3, atol=1e-6 * np.abs(expected).max())
    assert scores[0] == np.inf


def test_ltn_is_the_squared_norm_of_the_scaled_tangent() -> None:
    scores = ltn_scores(WEIGHTS, *CURVE)
    width, height = np.ptp(CURVE[0]), np.ptp(CURVE[1])
    expected = [
        (derivative(PROBLEM.rest, w) / width) ** 2 + (derivative(PROBLEM.constraint, w) / height) ** 2
        for w in WEIGHTS[1:]
    ]
    np.testing.assert_allclose(scores[1:], expected, rtol=1e-5)
    assert scores[0] == np.inf


@pytest.mark.parametrize("criterion", [l_curve_scores, scaled_l_curve_scores, ltn_scores])
def test_differences_stand_in_for_a_slope_that_is_not_given(criterion: Callable[..., Array]) -> None:
    fine = np.concatenate([[0.0], np.geomspace(1e-4, 1.0, 600)])
    rest, constraint, slope = PROBLEM.curve(fine)
    given, differences = criterion(fine, rest, constraint, slope), criterion(fine, rest, constraint)
    np.testing.assert_allclose(
        differences[3:-2], given[3:-2], rtol=5e-3, atol=1e-5 * np.abs(given[3:-2]).max()
    )


@pytest.mark.parametrize("criterion", [l_curve_scores, scaled_l_curve_scores, ltn_scores])
def test_units_of_the_objectives_do_not_matter(criterion: Callable[..., Array]) -> None:
    rest, constraint, slope = CURVE
    other = criterion(20.0 * WEIGHTS, rest * 4.0, constraint / 100.0, slope / 100.0)
    np.testing.assert_allclose(other[1:], criterion(WEIGHTS, *CURVE)[1:], rtol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_corner_of_an_l_is_near_the_best_regularisation(seed: int) -> None:
    problem = Tikhonov(seed)
    errors = [np.linalg.norm(problem.solution(w) - problem.truth) for w in WEIGHTS[1:]]
    scores = l_curve_scores(WEIGHTS, *problem.curve(WEIGHTS))
    chosen = lowest_valley(running_median(scores), np.ones(len(WEIGHTS), dtype=bool))
    assert errors[chosen - 1] < 3 * min(errors)


@pytest.mark.parametrize("criterion", [l_curve_scores, scaled_l_curve_scores, ltn_scores])
@pytest.mark.parametrize("constraint", [0.0, 2.5])
def test_a_flat_curve_chooses_no_constraint(criterion: Callable[..., Array], constraint: float) -> None:
    flat = np.full(len(WEIGHTS), constraint)
    scores = criterion(WEIGHTS, np.ones(len(WEIGHTS)), flat, np.zeros(len(WEIGHTS)))
    assert not np.isnan(scores).any()
    chosen = lowest_valley(running_median(scores), np.ones(len(WEIGHTS), dtype=bool))
    assert chosen <= 6


def test_running_median_is_that_of_eleven_neighbours_where_there_are_eleven() -> None:
    scores = np.random.default_rng(1).standard_normal(40)
    scores[7] = np.inf
    smooth = running_median(scores)
    for k in range(40):
        expected = sorted(scores[k - 5 : k + 6])[5] if 5 <= k < 35 else np.inf
        assert smooth[k] == expected


def test_the_lowest_score_is_admissible_finite_and_the_first_of_equal_ones() -> None:
    everything = np.ones(5, dtype=bool)
    assert lowest(np.array([3.0, 1.0, 2.0, 1.0, np.nan]), everything) == 1
    assert lowest(np.array([3.0, 1.0, 2.0, 0.5, np.inf]), np.array([1, 0, 1, 0, 1], dtype=bool)) == 2
    assert lowest(np.array([2.0, 2.0 * (1 - 1e-14), 3.0, 3.0, 3.0]), everything) == 0
    assert lowest(np.full(5, np.inf), everything) == 0
    assert lowest(np.ones(5), ~everything) == 0


def test_a_valley_is_preferred_to_an_end() -> None:
    everything = np.ones(7, dtype=bool)
    assert lowest_valley(np.array([np.inf, 0.0, 3.0, 2.0, 4.0, 1.0, np.inf]), everything) == 3
    assert lowest_valley(np.array([np.inf, 0.0, 3.0, 2.0, 2.0, 5.0, 1.0]), everything) == 3
    assert lowest_valley(np.array([np.inf, 1.0, 2.0, 3.0, 4.0, 5.0, np.inf]), everything) == 1
    outside = everything.copy()
    outside[3] = False
    assert lowest_valley(np.array([np.inf, 0.5, 3.0, 2.0, 4.0, 1.0, np.inf]), outside) == 1


def test_a_weight_is_admissible_with_nine_tenths_of_the_inliers() -> None:
    counts = np.array([40, 36, 35, 41], dtype=np.int32)
    np.testing.assert_array_equal(admissible_weights(counts, 40), [True, True, False, True])


def test_the_grid_is_zero_and_equal_ratios_from_end_to_end() -> None:
    grid = weight_grid()
    assert (len(grid), grid[0], grid[1], grid[-1]) == (100, 0.0, 1e-3, pytest.approx(1e3, rel=1e-12))
    np.testing.assert_allclose(grid[2:] / grid[1:-1], 10 ** (6 / 98), rtol=1e-12)


def test_refusals_name_argument_and_value() -> None:
    with pytest.raises(InvalidArgument, match="count = 2"):
        weight_grid(2)
    with pytest.raises(InvalidArgument, match=r"smallest = 1.0, largest = 0.5"):
        weight_grid(10, 1.0, 0.5)
    with pytest.raises(InvalidArgument, match="width = 4: must be odd"):
        running_median(np.ones(20), 4)
    with pytest.raises(InvalidArgument, match="scores: 10, must be at least 11"):
        running_median(np.ones(10))
    with pytest.raises(InvalidArgument, match="increase strictly"):
        l_curve_scores(np.array([0.0, 2.0, 1.0]), np.ones(3), np.ones(3))
    with pytest.raises(InvalidArgument, match=r"rest: shape \(2,\)"):
        ltn_scores(np.array([0.0, 1.0, 2.0]), np.ones(2), np.ones(3))
