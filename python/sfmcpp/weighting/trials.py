"""Fits over a grid of weights of one group, and the scores of each method."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sfmcpp import _core
from sfmcpp.ba.arrays import core_arrays
from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import BoolArray, FloatArray, IndexArray
from sfmcpp.weighting.criteria import admissible_weights, running_median
from sfmcpp.weighting.fits import WeightFit, WeightFits, total_weight
from sfmcpp.weighting.methods import WeightMethod
from sfmcpp.weighting.statistics import FitStatistics

# Factors on the weight at which images and constraint balance: half a decade a step, four decades each way;
# then, for a method that refines its choice, four more weights around it.
_COARSE = 10.0 ** (np.arange(-8, 9) / 2)
_FINE = 10.0 ** (np.array([-2, -1, 1, 2]) / 6)
# Of the running median of trade-off scores; that of a pose, with its finer grid, is wider.
_MEDIAN_WIDTH = 3
# Folds of cross-validation, and steps of each refit.
FOLDS = 4
_FOLD_STEPS = 8


@dataclass(frozen=True, eq=False)
class Trials:
    """Optima over weights of one group.

    Attributes
    ----------
    weights : (W,) float64
        The weights, increasing.
    fits : list of WeightFit
        The optimum of each.
    score : (W,) float64
        What the method minimises.
    admissible : (W,) bool
        Weights that keep at least 90 % of the inliers of the images alone.
    index : int
        The chosen one.
    """

    weights: FloatArray
    fits: Sequence[WeightFit]
    score: FloatArray
    admissible: BoolArray
    index: int


def admissible(fits: WeightFits, tried: Sequence[WeightFit]) -> BoolArray:
    """Which fits keep enough inliers of the images alone (thesis §5.2.3.2)."""
    return admissible_weights(np.array([fit.inliers for fit in tried]), fits.alone.inliers)


def sweep(fits: WeightFits, k: int, weights: FloatArray, start: WeightFit, method: WeightMethod) -> Trials:
    """Choose the weight of one group from a logarithmic grid, the other groups held.

    Parameters
    ----------
    fits : WeightFits
        Problem and groups.
    k : int
        Number of the group.
    weights : (k,) float64
        Present weights; that of the group is the middle of the grid.
    start : WeightFit
        The optimum at these weights. Each fit starts at that of its neighbour nearer to it.
    method : WeightMethod
        How to score and choose.

    Returns
    -------
    Trials
        All optima and the choice.
    """
    grid = np.unique([fits.bounded(k, weights[k] * factor) for factor in _COARSE])
    trials = _trials(fits, k, weights, _fits_outwards(fits, k, weights, grid, start), method)
    if not method.refines:
        return trials
    here = trials.weights[trials.index]
    known = dict(zip(trials.weights.tolist(), trials.fits, strict=True))
    for factor in _FINE:
        weight = fits.bounded(k, here * factor)
        known[weight] = fits.fit(_with_weight(weights, k, weight), trials.fits[trials.index].problem)
    return _trials(fits, k, weights, known, method)


def _fits_outwards(
    fits: WeightFits, k: int, weights: FloatArray, grid: FloatArray, start: WeightFit
) -> dict[float, WeightFit]:
    middle = int(np.searchsorted(grid, weights[k]))
    found: dict[float, WeightFit] = {}
    for part in (grid[middle:], grid[:middle][::-1]):
        fit = start
        for weight in part:
            fit = found[float(weight)] = fits.fit(_with_weight(weights, k, weight), fit.problem)
    return found


def _trials(
    fits: WeightFits, k: int, weights: FloatArray, found: dict[float, WeightFit], method: WeightMethod
) -> Trials:
    tried = np.array(sorted(found))
    optima = [found[float(weight)] for weight in tried]
    score = score_of(method)(fits, k, np.array([_with_weight(weights, k, w) for w in tried]), optima)
    allowed = admissible(fits, optima)
    return Trials(tried, optima, score, allowed, method.choose(score, allowed))


def _with_weight(weights: FloatArray, k: int, weight: float) -> FloatArray:
    changed: FloatArray = weights.copy()
    changed[k] = weight
    return changed


Scores = Callable[[WeightFits, int, FloatArray, Sequence[WeightFit]], FloatArray]


def score_of(method: WeightMethod) -> Scores:
    """(W,) scores of the weights of group k, given as (W, groups), and their optima."""
    if method.trade_off is None:
        return {"loo-approx": _left_out_losses, "k-fold": _fold_losses}[method.name]
    criterion = method.trade_off

    def score(fits: WeightFits, k: int, weights: FloatArray, optima: Sequence[WeightFit]) -> FloatArray:
        """In the terms of one pose: means ρ and ν, and λ² with ``M (ρ + λ² ν)`` the cost."""
        count, members = fits.alone.problem.num_observations, total_weight(fits.groups[k].member_weights)
        errors = np.array([fit.errors for fit in optima])
        others = np.delete(weights * errors, k, axis=1).sum(axis=1)
        rest = (np.array([fit.images for fit in optima]) + others) / count
        lambdas = np.sqrt(weights[:, k] * members / count)
        return running_median(criterion(lambdas, rest, errors[:, k] / members, None), _MEDIAN_WIDTH)

    return score


def _left_out_losses(
    fits: WeightFits, _: int, weights: FloatArray, optima: Sequence[WeightFit]
) -> FloatArray:
    return np.array(
        [FitStatistics(fits, fit.problem, w).left_out_error() for w, fit in zip(weights, optima, strict=True)]
    )


def _fold_losses(fits: WeightFits, _: int, weights: FloatArray, optima: Sequence[WeightFit]) -> FloatArray:
    """Mean loss of left-out observations: a fold leaves out one of each point with `FOLDS` views or more."""
    fold = fold_of_observation(fits.alone.problem.point_index)
    if (fold < 0).all():
        raise InvalidArgument(
            f"weight = 'k-fold': no point has {FOLDS} observations, one to leave out of each"
        )
    total = np.zeros(len(optima))
    for i, (fit, w) in enumerate(zip(optima, weights, strict=True)):
        for left_out in (fold == f for f in range(FOLDS)):
            state = fits.fit_subset(w, fit.problem, ~left_out, _FOLD_STEPS)
            residuals = np.asarray(_core.residuals(core_arrays(state)))[left_out]
            total[i] += fits.left_out_loss((residuals**2).sum(axis=1)).sum()
    return np.asarray(total / np.count_nonzero(fold >= 0))


def fold_of_observation(point_index: IndexArray) -> NDArray[np.int64]:
    """The fold that leaves each observation out; −1: none.

    The places of a point's observations, in their order, are split evenly over the folds, from another place
    for each point: a fold leaves out at most one of them, and of points with fewer than `FOLDS` none.

    Parameters
    ----------
    point_index : (M,) int32
        Point of each observation.

    Returns
    -------
    (M,) int
        Folds.
    """
    count = len(point_index)
    order = np.argsort(point_index, kind="stable")
    ordered = point_index[order]
    first = np.searchsorted(ordered, ordered)
    views = np.searchsorted(ordered, ordered, side="right") - first
    place = (np.arange(count) - first + ordered) % views
    before, here = (place * FOLDS + views - 1) // views, ((place + 1) * FOLDS + views - 1) // views
    fold = np.empty(count, dtype=np.int64)
    fold[order] = np.where((views >= FOLDS) & (here > before), before, -1)
    return fold
