"""The weight of positions beside images: adjusted with both, their standard deviation found.

Problems of moderate size leave that to :func:`sfmcpp.weighting.solve`, whose hat matrices grow with the
square of the cameras. Of larger ones, Helmert's estimate is iterated: ``σ² = Σ w e² / (n − tr K)``, with the
trace of the hat matrix K from its entries of some positions, spread over all.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from sfmcpp.model import ConstraintGroup, Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sfm.fit_statistics import cost_variance, linear_model
from sfmcpp.weighting import solve
from sfmcpp.weighting.statistics import MAX_COLUMNS

# Positions whose entries of the hat matrix stand for all.
_SAMPLED = 60
# Converged where σ changes by no more than this part: of a thousand positions, its own σ is larger.
_SETTLED, _ROUNDS = 0.01, 12
# Bounds of σ, as a part of the extent of the positions, and of the redundancy, as a part of their numbers.
_LEAST_SIGMA, _LEAST_REDUNDANCY = 1e-6, 1e-3


def adjust_with_positions(
    problem: Problem,
    group: ConstraintGroup,
    sigma_m: float | None,
    options: dict[str, Any],
    loss_scale_px: float,
) -> tuple[float, float, float]:
    """Adjust images and positions together, at the weight that restricted likelihood gives these.

    Parameters
    ----------
    problem : Problem
        In the world of the positions; it is adjusted.
    group : ConstraintGroup
        The positions; it gets the weight.
    sigma_m : float or None
        What an earlier call found of nearly the same positions.
    options : dict
        Of the adjustment.
    loss_scale_px : float
        Scale of the loss, as the last adjustment had it.

    Returns
    -------
    (float, float, float)
        σ of a coordinate of a position of weight 1 [m], how many numbers the fit leaves over, and the scale
        that the loss ends with.
    """
    if _num_columns(problem) > MAX_COLUMNS:
        return _adjusted_in_rounds(problem, group, sigma_m, options, loss_scale_px)
    summary = solve(problem, constraints=[group], weight="auto", **options).require_uninterrupted()
    weight = summary.group_weights[0]
    redundancy = np.inf if weight.redundancy is None else weight.redundancy
    return weight.sensor_sigma, redundancy, summary.loss_scale_px


def _num_columns(problem: Problem) -> int:
    return int(6 * problem.num_cameras + np.count_nonzero(np.logical_not(problem.fixed_intrinsics)))


def _adjusted_in_rounds(
    problem: Problem,
    group: ConstraintGroup,
    sigma_m: float | None,
    options: dict[str, Any],
    loss_scale_px: float,
) -> tuple[float, float, float]:
    weights = _weights_of_coordinates(group)
    least = _LEAST_SIGMA * float(np.ptp(_metres(group), axis=0).max())
    if sigma_m is None:
        sigma_m = _sigma(problem, group, weights, weights.size)
    for _ in range(_ROUNDS):
        sigma_m = max(sigma_m, least)
        variance = cost_variance(linear_model(problem, [], options, loss_scale_px))
        group.weight = 3 / sigma_m**2 * variance
        summary = solve(problem, constraints=[group], **options).require_uninterrupted()
        loss_scale_px = summary.loss_scale_px
        redundancy = _redundancy(problem, group, weights, options, loss_scale_px)
        found_m = _sigma(problem, group, weights, redundancy)
        if abs(np.log(max(found_m, least) / sigma_m)) <= _SETTLED:
            break
        sigma_m = found_m
    return sigma_m, redundancy, loss_scale_px


def _metres(group: ConstraintGroup) -> FloatArray:
    return np.asarray(group.values, dtype=np.float64)


def _weights_of_coordinates(group: ConstraintGroup) -> FloatArray:
    """(n, 3) those beside one another."""
    weights = np.asarray(group.member_weights, dtype=np.float64)
    return np.broadcast_to(weights.reshape(len(weights), -1), (group.num_members, 3))


def _sigma(problem: Problem, group: ConstraintGroup, weights: FloatArray, redundancy: float) -> float:
    apart = problem.centres[group.cameras] - _metres(group)
    return float(np.sqrt((weights * apart**2).sum() / redundancy))


def _redundancy(
    problem: Problem,
    group: ConstraintGroup,
    weights: FloatArray,
    options: dict[str, Any],
    loss_scale_px: float,
) -> float:
    """How many of the numbers of a group an adjustment with it leaves over."""
    count = group.num_members
    some = np.unique(np.linspace(0, count - 1, min(count, _SAMPLED)).astype(np.int32))
    model = linear_model(problem, [group], options, loss_scale_px)
    covariances = model.covariance(cameras=group.cameras[some]).cameras
    variances = np.diagonal(covariances, axis1=1, axis2=2)[:, 3:6]
    used = float((group.weight / 3 * weights[some] * variances).sum(axis=1).mean()) * count
    return max(weights.size - used, _LEAST_REDUNDANCY * weights.size)
