"""Methods of weight selection by name, for the constraint of a pose or a group of a problem."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.weighting import criteria

Scope = Literal["pose", "problem"]
TradeOff = Callable[[FloatArray, FloatArray, FloatArray, "FloatArray | None"], FloatArray]
_FIXED = "fixed:"
_LARGEST = 1e100  # whose square, times any count, is a number
# Rounds over several constraints: each weight is chosen with the others in place, then once more.
ROUNDS = 2
_WHERE = {"pose": "one pose", "problem": "a whole problem"}


@dataclass(frozen=True)
class WeightMethod:
    """One way to choose a weight.

    Attributes
    ----------
    name : str
        Its name.
    scopes : tuple of str
        "pose", "problem": what data it can choose by.
    choose : callable
        Index of the weight to take, from scores and which weights are admissible.
    trade_off : callable or None
        Scores λ, ρ, ν and dν / d log λ (:mod:`sfmcpp.weighting.criteria`); None: scores by other means.
    refines : bool
        Whether more weights around the first choice make sense.
    grid : (W,) float64 or None
        Weights the method prescribes; None: any grid.
    """

    name: str
    scopes: tuple[Scope, ...]
    choose: Callable[[FloatArray, BoolArray], int]
    trade_off: TradeOff | None = None
    refines: bool = False
    grid: FloatArray | None = None


def _largest_weight(scores: FloatArray, _: BoolArray) -> int:
    """Last weight of the grid: prescribed weights are used regardless of the inliers."""
    return len(scores) - 1


def _trade_off_method(name: str, scores: TradeOff) -> WeightMethod:
    return WeightMethod(name, ("pose", "problem"), criteria.lowest_valley, scores)


WEIGHT_METHODS: dict[str, WeightMethod] = {
    method.name: method
    for method in (
        WeightMethod("auto", ("problem",), _largest_weight),
        WeightMethod("variance", ("problem",), _largest_weight),
        WeightMethod("loo", ("pose",), criteria.lowest),
        WeightMethod("loo-approx", ("pose", "problem"), criteria.lowest, refines=True),
        WeightMethod("k-fold", ("problem",), criteria.lowest, refines=True),
        _trade_off_method("l-curve", criteria.l_curve_scores),
        _trade_off_method("l-curve-scaled", criteria.scaled_l_curve_scores),
        _trade_off_method("ltn", criteria.ltn_scores),
        WeightMethod("fixed:λ", ("pose",), _largest_weight),
        WeightMethod("none", ("pose",), _largest_weight, grid=np.zeros(1)),
    )
}


def _names(scope: Scope) -> tuple[str, ...]:
    return tuple(name for name, method in WEIGHT_METHODS.items() if scope in method.scopes)


POSE_METHODS = _names("pose")
PROBLEM_METHODS = _names("problem")


@checked()
def selection_method(text: str, scope: Scope = "pose", argument: str = "method") -> WeightMethod:
    """Look a method up by what the user wrote.

    Parameters
    ----------
    text : str
        One of `POSE_METHODS` or `PROBLEM_METHODS`, with a number in place of λ.
    scope : {"pose", "problem"}
        What there is to choose by.
    argument : str
        What messages call the text.

    Returns
    -------
    WeightMethod
        The method.

    Raises
    ------
    InvalidArgument
        If there is no such method, it cannot choose by what there is, or the number after ``fixed:`` is not a
        weight.
    """
    name = "fixed:λ" if text.startswith(_FIXED) else text
    method = WEIGHT_METHODS.get(name)
    known = ", ".join(_names(scope))
    if method is None:
        raise InvalidArgument(f"{argument} = {text!r}: must be one of {known}")
    if scope not in method.scopes:
        other = _WHERE[method.scopes[0]]
        raise InvalidArgument(
            f"{argument} = {text!r}: is for {other}; for {_WHERE[scope]} must be one of {known}"
        )
    return _prescribed_weight(text, argument) if name == "fixed:λ" else method


def _prescribed_weight(text: str, argument: str) -> WeightMethod:
    try:
        weight = float(text.removeprefix(_FIXED))
    except ValueError:
        weight = np.nan
    if not 0 <= weight <= _LARGEST:
        raise InvalidArgument(f"{argument} = {text!r}: the weight must be a number from 0 to {_LARGEST:g}")
    grid = np.array([0.0, weight]) if weight > 0 else np.zeros(1)
    return WeightMethod(text, ("pose",), _largest_weight, grid=grid)
