"""Points moved to the least sum of squared reprojection errors with all cameras fixed, all at once."""

from __future__ import annotations

import numpy as np

from sfmcpp.geometry._tracks import (
    intrinsics_of_observations,
    num_views,
    points_in_cameras,
    require_metric,
    require_points,
    sum_by_point,
    sum_outer_by_point,
)
from sfmcpp.geometry.pinhole import image_slopes, to_pixels
from sfmcpp.model import Problem
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.checks import require_count
from sfmcpp.model.uncertainty import Whitener

_FIRST_DAMPING = 1e-4
# With less, the matrix of a point that runs away along its ray, of rank two, is singular to rounding.
_LEAST_DAMPING = 1e-10
# A point rests when a step promises to lower its cost by no more than this part of it, or by rounding.
_TOLERANCE = 1e-10
_ROUNDING_PX2 = 1e-20


@checked()
def refine_points(problem: Problem, points: FloatArray, *, max_steps: int = 20) -> FloatArray:
    """Refine points by damped Gauss–Newton steps on their reprojection errors, each with its own damping.

    A step counts only if it lowers the point's cost with the point in front of all its cameras, so no point
    gets worse.

    Parameters
    ----------
    problem : Problem
        Of any metric camera model; its observations are weighted by its standard deviations or covariances.
    points : (N, 3) float64
        World points to start from. Those that are not finite, behind a camera that observes them, or observed
        less than twice, stay.
    max_steps : int
        Steps at most, at least 1.

    Returns
    -------
    (N, 3) float64

    Raises
    ------
    InvalidArgument
        If `points` has another shape, `max_steps` is below one, the problem is projective, has
        numbers that are not finite or indices out of range.
    """
    require_metric(problem)
    require_count("max_steps", max_steps, 1)
    best: FloatArray = require_points(problem, points).copy()
    costs = _costs(problem, best)
    damping = np.full(len(best), _FIRST_DAMPING)
    active = np.isfinite(costs) & (num_views(problem) >= 2)
    for _ in range(max_steps):
        steps, predicted = _steps(problem, best, damping, active)
        active &= predicted > _TOLERANCE * costs + _ROUNDING_PX2
        if not active.any():
            break
        candidates = best + np.where(active[:, None], steps, 0.0)
        candidate_costs = _costs(problem, candidates)
        accepted = active & (candidate_costs < costs)
        best[accepted], costs[accepted] = candidates[accepted], candidate_costs[accepted]
        damping = np.where(accepted, np.maximum(damping / 10, _LEAST_DAMPING), damping * 10)
    return best


def _costs(problem: Problem, points: FloatArray) -> FloatArray:
    """(N,) sum of squared weighted errors of each point; infinite where it is not in front of all cameras."""
    in_camera = points_in_cameras(problem, points)
    in_front = in_camera[:, 2] > 0
    in_camera[~in_front] = 1.0
    squares = (_residuals(problem, in_camera) ** 2).sum(axis=1)
    return np.asarray(sum_by_point(problem, np.where(in_front, squares, np.inf)[:, None])[:, 0])


def _residuals(problem: Problem, in_camera: FloatArray) -> FloatArray:
    """(M, 2) ``(projected − observed) / σ``, or whitened by covariances."""
    pixels = to_pixels(in_camera[:, :2] / in_camera[:, 2:], intrinsics_of_observations(problem))
    whitener = _whitener(problem)
    return whitener.finish(np.asarray((pixels - problem.pixels) / whitener.sigma_px[:, None]))


def _whitener(problem: Problem) -> Whitener:
    return Whitener.of(problem.sigma_px, problem.covariance_px2)


def _steps(
    problem: Problem, points: FloatArray, damping: FloatArray, active: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Steps (N, 3) ``δ = −(H + μ diag H)⁻¹ Jᵀ r`` of active points, and (N,) ``−rᵀ J δ``: their promise."""
    # The others may be anywhere, also where nothing is defined: they take part as points at depth one.
    in_camera = np.where(active[problem.point_index, None], points_in_cameras(problem, points), 1.0)
    jacobians = _jacobians(problem, in_camera)
    gradients = (jacobians * _residuals(problem, in_camera)[:, :, None]).sum(axis=1)
    descent = -sum_by_point(problem, gradients)
    hessian = sum_outer_by_point(problem, jacobians)
    hessian += damping[:, None, None] * (hessian * np.eye(3))
    hessian[~active] = np.eye(3)
    steps = np.asarray(np.linalg.solve(hessian, descent[:, :, None])[:, :, 0], dtype=np.float64)
    return steps, np.asarray((steps * descent).sum(axis=1))


def _jacobians(problem: Problem, in_camera: FloatArray) -> FloatArray:
    """(M, 2, 3) derivatives of the residuals with respect to the world point (note eqs 6 and 10)."""
    depth = in_camera[:, 2:]
    slopes = image_slopes(in_camera[:, :2] / depth, intrinsics_of_observations(problem))
    towards = -(slopes[:, :, 0] * in_camera[:, :1] + slopes[:, :, 1] * in_camera[:, 1:2]) / depth
    by_camera_point = np.concatenate([slopes, towards[:, :, None]], axis=2)
    whitener = _whitener(problem)
    by_camera_point /= (depth * whitener.sigma_px[:, None])[:, :, None]
    camera_from_world = np.swapaxes(problem.rotations, 1, 2)[problem.camera_index]
    return np.asarray(whitener.finish(by_camera_point) @ camera_from_world)
