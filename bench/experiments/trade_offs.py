"""The two criteria of compromise as their derivatives are taken, and how many curves have a corner."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.figure import Figure

from experiments.description import Experiment, Row
from experiments.keyframe_weights import KeyframePose, poses_of
from experiments.report import Report
from sfmcpp.model.arrays import FloatArray
from sfmcpp.study.plotting.style import new_figure, style_axes
from sfmcpp.weighting import WeightSweep, sweep_weights, weight_grid
from sfmcpp.weighting.criteria import (
    admissible_weights,
    l_curve_scores,
    lowest,
    ltn_scores,
    running_median,
)

NOTES = (
    "Visual SLAM alone; at each keyframe both errors over the 99 weights of eq. 5.6, a running median of 11",
    "of each criterion, its least value among the weights that keep 90 % of the inliers. median, mean: of",
    "these weights. first, last: share of keyframes at which it is the first or last that can be chosen.",
    "corner: share of curves whose exact curvature is positive and largest between the ends of all weights;",
    "admissible_corner: of those that keep the inliers. noise: share of differences of ρ and ν of the wrong",
    "sign. The exact curvature does not depend on the variable, its differences do.",
)
COLUMNS = (
    "drives", "sensor", "criterion", "keyframes", "median", "mean", "first", "last", "corner",
    "admissible_corner", "noise",
)  # fmt: skip
Scores = Callable[[WeightSweep], FloatArray]
_MARGIN = 5  # scores that a running median of 11 lacks at an end


def trade_off_criteria(experiment: Experiment) -> Report:
    """Choose at every keyframe by every criterion."""
    rows, curves = [], {}
    for (group, sensor), poses in poses_of(experiment).items():
        sweeps = [_sweep(found) for found in poses]
        rows += [_row(group, sensor, name, scores, sweeps) for name, scores in CRITERIA.items()]
        curves[f"{sensor}, {group}"] = [l_curve_scores(*_curve(sweep)) for sweep in sweeps]
    return Report(NOTES, ("sensor", "criterion"), COLUMNS, rows, _picture(curves))


def _sweep(found: KeyframePose) -> WeightSweep:
    return sweep_weights(found.view, found.constraint, weight_grid(), found.pose)


def _curve(sweep: WeightSweep) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """λ, ρ, ν and dν / d log λ at the positive weights."""
    return sweep.weights[1:], sweep.vision[1:], sweep.constraint[1:], sweep.constraint_slope[1:]


def _exact_l_curve(sweep: WeightSweep) -> FloatArray:
    return l_curve_scores(*_curve(sweep))


def _exact_ltn(sweep: WeightSweep) -> FloatArray:
    return ltn_scores(*_curve(sweep))


def _exact_ltn_over_weights(sweep: WeightSweep) -> FloatArray:
    """The same tangent, over λ: d / dλ is d / d log λ over λ."""
    return np.asarray(_exact_ltn(sweep) / sweep.weights[1:] ** 2)


def _l_curve_by_differences(variable: Callable[[FloatArray], FloatArray]) -> Scores:
    def scores(sweep: WeightSweep) -> FloatArray:
        weights, rho, nu, _ = _curve(sweep)
        x = variable(weights)
        (r1, n1), (r2, n2) = _derivatives(np.log(rho), np.log(nu), x)
        with np.errstate(divide="ignore", invalid="ignore"):
            curvature = 2 * (r1 * n2 - r2 * n1) / (r1**2 + n1**2) ** 1.5
        return np.where(np.isfinite(curvature), -curvature, np.inf)

    return scores


def _ltn_by_differences(variable: Callable[[FloatArray], FloatArray]) -> Scores:
    def scores(sweep: WeightSweep) -> FloatArray:
        weights, rho, nu, _ = _curve(sweep)
        slopes = [np.gradient(y / np.ptp(y), variable(weights)) for y in (rho, nu)]
        return np.asarray(slopes[0] ** 2 + slopes[1] ** 2)

    return scores


def _derivatives(
    rho: FloatArray, nu: FloatArray, x: FloatArray
) -> tuple[tuple[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]:
    first = np.gradient(rho, x), np.gradient(nu, x)
    return first, (np.gradient(first[0], x), np.gradient(first[1], x))


def _itself(weights: FloatArray) -> FloatArray:
    return weights


CRITERIA: dict[str, Scores] = {
    "l-curve, exact": _exact_l_curve,
    "l-curve, log λ, differences": _l_curve_by_differences(np.log),
    "l-curve, λ, differences": _l_curve_by_differences(_itself),
    "ltn, log λ, exact": _exact_ltn,
    "ltn, log λ, differences": _ltn_by_differences(np.log),
    "ltn, λ, exact": _exact_ltn_over_weights,
    "ltn, λ, differences": _ltn_by_differences(_itself),
}


def _row(group: str, sensor: str, name: str, scores: Scores, sweeps: Sequence[WeightSweep]) -> Row:
    chosen, ends = zip(*(_choose(sweep, scores(sweep)) for sweep in sweeps), strict=True)
    curvature = name == "l-curve, exact"
    return {
        "drives": group,
        "sensor": sensor,
        "criterion": name,
        "keyframes": len(sweeps),
        "median": float(np.median(chosen)),
        "mean": float(np.mean(chosen)),
        "first": float(np.mean([end == "first" for end in ends])),
        "last": float(np.mean([end == "last" for end in ends])),
        "corner": float(np.mean([_has_corner(s, s.weights > 0) for s in sweeps])) if curvature else None,
        "admissible_corner": float(np.mean([_has_corner(s, _admissible(s)) for s in sweeps]))
        if curvature
        else None,
        "noise": float(np.mean([_wrong_slopes(s) for s in sweeps])) if "differences" in name else None,
    }


def _admissible(sweep: WeightSweep) -> FloatArray:
    return np.asarray(admissible_weights(sweep.inliers, int(sweep.inliers[0])) & (sweep.weights > 0))


def _choose(sweep: WeightSweep, scores: FloatArray) -> tuple[float, str]:
    """The weight, and whether it is the first or the last there is to choose."""
    admissible = _admissible(sweep)[1:]
    admissible[:_MARGIN] = admissible[len(admissible) - _MARGIN :] = False
    if not admissible.any():
        return 0.0, "none"
    index = lowest(running_median(scores), admissible)
    first, *_, last = np.flatnonzero(admissible).tolist() * 2
    return float(sweep.weights[1 + index]), {first: "first", last: "last"}.get(index, "")


def _has_corner(sweep: WeightSweep, among: FloatArray) -> bool:
    """Whether the curvature is positive and largest between the ends of some weights."""
    scores = _exact_l_curve(sweep)[among[1:]]
    if len(scores) < 3:
        return False
    index = int(np.argmin(scores))
    return bool(scores[index] < 0 and 0 < index < len(scores) - 1)


def _wrong_slopes(sweep: WeightSweep) -> float:
    """Share of differences of ρ that fall and of ν that rise, where a larger weight can do neither."""
    _, rho, nu, _ = _curve(sweep)
    return float(np.mean(np.append(np.diff(rho) < 0, np.diff(nu) > 0)))


def _picture(curves: dict[str, list[FloatArray]]) -> Figure:
    """Exact curvature over λ: median and quartiles over the keyframes."""
    weights = weight_grid()[1:]
    figure = new_figure(3.6 * len(curves), 3.4)
    for axes, (title, scores) in zip(
        np.atleast_1d(figure.subplots(1, len(curves))), curves.items(), strict=True
    ):
        low, middle, high = np.percentile(-np.array(scores), [25, 50, 75], axis=0)
        axes.fill_between(weights, low, high, alpha=0.3)
        axes.plot(weights, middle)
        axes.set_xscale("log")
        axes.set_yscale("symlog")
        axes.set_title(title, fontsize=9)
        axes.set_xlabel("weight λ")
        style_axes(axes)
    return figure
