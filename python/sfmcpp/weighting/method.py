"""The ways to choose a weight, by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.weighting import criteria
from sfmcpp.weighting.sweep import WeightSweep

METHODS = ("loo", "loo-approx", "l-curve", "l-curve-scaled", "ltn", "fixed:λ", "none")
_FIXED = "fixed:"


@dataclass(frozen=True)
class SelectionMethod:
    """One way to choose a weight from a sweep.

    Attributes
    ----------
    name : str
        Its name.
    score : callable
        (W,) scores of the weights of a sweep.
    choose : callable
        Index of the weight to take, from scores and which weights are admissible.
    grid : (W,) float64 or None
        Weights the method prescribes; None: any grid.
    """

    name: str
    score: Callable[[WeightSweep], FloatArray]
    choose: Callable[[FloatArray, BoolArray], int]
    grid: FloatArray | None = None


def selection_method(text: str) -> SelectionMethod:
    """Look a method up by what the user wrote.

    Parameters
    ----------
    text : str
        One of `METHODS`, with a number in place of λ.

    Returns
    -------
    SelectionMethod
        The method.

    Raises
    ------
    InvalidArgument
        If there is no such method, or the number after ``fixed:`` is not a weight.
    """
    if text in _BY_NAME:
        return _BY_NAME[text]
    if text.startswith(_FIXED):
        return _fixed(text)
    raise InvalidArgument(f"method = {text!r}: must be one of {', '.join(METHODS)}")


def _fixed(text: str) -> SelectionMethod:
    try:
        weight = float(text.removeprefix(_FIXED))
    except ValueError:
        weight = np.nan
    if not (np.isfinite(weight) and weight >= 0):
        raise InvalidArgument(f"method = {text!r}: the weight must be a finite number, not negative")
    grid = np.array([0.0, weight]) if weight > 0 else np.zeros(1)
    return SelectionMethod(text, _no_score, _last, grid)


def _no_score(sweep: WeightSweep) -> FloatArray:
    return np.zeros_like(sweep.weights)


def _last(scores: FloatArray, _: BoolArray) -> int:
    """Prescribed weights are taken whatever they do to the inliers."""
    return len(scores) - 1


def _trade_off(
    scores: Callable[[FloatArray, FloatArray, FloatArray, FloatArray], FloatArray],
) -> Callable[[WeightSweep], FloatArray]:
    def score(sweep: WeightSweep) -> FloatArray:
        rest = sweep.vision + sweep.held
        return criteria.running_median(scores(sweep.weights, rest, sweep.constraint, sweep.constraint_slope))

    return score


_BY_NAME = {
    method.name: method
    for method in (
        SelectionMethod("loo", lambda sweep: sweep.leave_one_out, criteria.lowest),
        SelectionMethod("loo-approx", lambda sweep: sweep.approximate_leave_one_out, criteria.lowest),
        SelectionMethod("l-curve", _trade_off(criteria.l_curve_scores), criteria.lowest_valley),
        SelectionMethod("l-curve-scaled", _trade_off(criteria.scaled_l_curve_scores), criteria.lowest_valley),
        SelectionMethod("ltn", _trade_off(criteria.ltn_scores), criteria.lowest_valley),
        SelectionMethod("none", _no_score, _last, np.zeros(1)),
    )
}
