"""World points from their images in calibrated cameras: linear, midpoint and optimal, all points at once.

The cameras, intrinsics and observations are those of a problem; its points are ignored. A point that its
observations leave open, with fewer than two rays or with parallel ones, is not a number.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sfmcpp.geometry._tracks import (
    intrinsics_of_observations,
    mean_by_point,
    normalised_pixels,
    num_views,
    observed_rays,
    points_in_cameras,
    require_metric,
    require_points,
    sum_by_point,
    sum_outer_by_point,
)
from sfmcpp.geometry.epipolar import fundamental_matrix, midpoints
from sfmcpp.geometry.pinhole import PINHOLE, homogeneous, image_slopes, pinhole_rows, to_normalised, to_pixels
from sfmcpp.model import Problem
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.checks import require_count
from sfmcpp.model.uncertainty import Whitener

# Rays are parallel where what holds a point along them is this part of what holds it across: their angle
# is then about 1e-6 rad, far below what a pixel can tell.
_PARALLEL_RATIO = 1e-12
# Centres coincide where their spread is this part of their distance from the origin: rounding.
_SAME_PLACE_RATIO = 1e-14
_FIRST_DAMPING = 1e-4
# With less, the matrix of a point that runs away along its ray, of rank two, is singular to rounding.
_LEAST_DAMPING = 1e-10
# A point rests when a step promises to lower its cost by no more than this part of it, or by rounding.
_TOLERANCE = 1e-10
_ROUNDING_PX2 = 1e-20
# The error of the closed form's two steps is below 1e-6 px for all but absurd noise; more cost little.
_NUM_STEPS = 5


@checked()
def triangulate_linear(problem: Problem) -> FloatArray:
    """Triangulate by homogeneous linear least squares over all views (DLT; Hartley & Sturm 1997, §5.1).

    Each observation (x, y) of a camera [r₁ r₂ r₃ | c] gives the rows ``x r₃ − r₁`` and ``y r₃ − r₂``. The
    origin is moved to the mean of the centres that see the point, the unit length to their spread: the
    result follows any similarity of the world.

    Parameters
    ----------
    problem : Problem
        Of any metric camera model, with any number of observations of each of its N points.

    Returns
    -------
    (N, 3) float64
        Not a number where the observations leave a point open.

    Raises
    ------
    InvalidArgument
        If the problem is projective, has numbers that are not finite or indices out of range.
    """
    require_metric(problem)
    origin, length = _local_frames(problem)
    _, vectors = np.linalg.eigh(sum_outer_by_point(problem, _linear_rows(problem, origin, length)))
    x, w = vectors[:, :3, 0], vectors[:, 3, 0]
    determined = _determined(_across_matrices(problem), origin, length) & (w != 0)
    local = x / np.where(determined, w, 1.0)[:, None]
    return _nan_unless(determined, origin + length[:, None] * local)


@checked()
def triangulate_midpoint(problem: Problem) -> FloatArray:
    """Triangulate by the point nearest to all its rays, in the sum of squared distances.

    Between two rays it is the midpoint of their shortest connection. ``Σ (I − d dᵀ)(X − c) = 0`` over the
    centres c and directions d of the rays.

    Parameters
    ----------
    problem : Problem
        Of any metric camera model, with any number of observations of each of its N points.

    Returns
    -------
    (N, 3) float64
        Not a number where the observations leave a point open.

    Raises
    ------
    InvalidArgument
        If the problem is projective, has numbers that are not finite or indices out of range.
    """
    require_metric(problem)
    origin, length = _local_frames(problem)
    left = _across_matrices(problem)
    determined = _determined(left, origin, length)
    left[~determined] = np.eye(3)
    right = sum_by_point(problem, _centres_across_rays(problem, origin))
    return _nan_unless(determined, origin + np.linalg.solve(left, right[:, :, None])[:, :, 0])


def _local_frames(problem: Problem) -> tuple[FloatArray, FloatArray]:
    """Mean (N, 3) of the centres that see each point, and their root mean squared distance (N,) from it."""
    centres = problem.centres[problem.camera_index]
    origin = mean_by_point(problem, centres)
    offsets = centres - origin[problem.point_index]
    return origin, np.sqrt(mean_by_point(problem, (offsets**2).sum(axis=1, keepdims=True))[:, 0])


def _linear_rows(problem: Problem, origin: FloatArray, length: FloatArray) -> FloatArray:
    """(M, 2, 4) rows of the linear system of each observation, in the frame of its point."""
    axes = np.swapaxes(problem.rotations, 1, 2)[problem.camera_index]
    normals = normalised_pixels(problem)[:, :, None] * axes[:, 2:] - axes[:, :2]
    offsets = problem.centres[problem.camera_index] - origin[problem.point_index]
    unit_length = np.where(length > 0, length, 1.0)[problem.point_index, None]
    return np.concatenate([normals, -(normals @ (offsets / unit_length)[:, :, None])], axis=2)


def _centres_across_rays(problem: Problem, origin: FloatArray) -> FloatArray:
    """(M, 3) ``(I − d dᵀ) c`` with the centre c counted from the origin of its point."""
    rays = observed_rays(problem)
    offsets = problem.centres[problem.camera_index] - origin[problem.point_index]
    return np.asarray(offsets - (offsets * rays).sum(axis=1, keepdims=True) * rays)


def _across_matrices(problem: Problem) -> FloatArray:
    """(N, 3, 3) ``Σ (I − d dᵀ)`` over the rays of each point: what holds it across them."""
    along = sum_outer_by_point(problem, observed_rays(problem)[:, None, :])
    return np.asarray(num_views(problem)[:, None, None] * np.eye(3) - along)


def _determined(across: FloatArray, origin: FloatArray, length: FloatArray) -> BoolArray:
    """(N,) whether the rays of each point differ in direction and start from more than one place."""
    held = np.linalg.eigvalsh(across)
    have_baseline = length > _SAME_PLACE_RATIO * np.linalg.norm(origin, axis=1)
    return np.asarray(have_baseline & (held[:, 0] > _PARALLEL_RATIO * held[:, 2]))


def _nan_unless(good: BoolArray, points: FloatArray) -> FloatArray:
    return np.where(good[:, None], points, np.nan)


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
    in_front = (in_camera[:, 2] > 0) & np.isfinite(in_camera).all(axis=1)
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


@checked()
def triangulate_optimal(problem: Problem) -> FloatArray:
    """Triangulate by the least sum of squared reprojection errors, weighted by the standard deviations.

    Of two observations it is the global minimum: both are moved by least squares onto a pair of epipolar
    lines (P. Lindstrom, "Triangulation made easy", CVPR 2010), where their rays meet. Of more, and of lenses
    with distortion, it is the local minimum that Gauss–Newton steps find from there, or from the linear
    solution.

    Parameters
    ----------
    problem : Problem
        Of any metric camera model, with any number of observations of each of its N points.

    Returns
    -------
    (N, 3) float64
        Not a number where the observations leave a point open.

    Raises
    ------
    InvalidArgument
        If the problem is projective, has numbers that are not finite or indices out of range.
    """
    points = triangulate_linear(problem)
    twice = np.flatnonzero((num_views(problem) == 2) & np.isfinite(points).all(axis=1))
    if len(twice):
        points[twice] = _of_two_views(problem, _observations_of(problem, twice))
    return refine_points(problem, points)


def _observations_of(problem: Problem, points: NDArray[np.intp]) -> NDArray[np.intp]:
    """(2, T) observations of points that have two each."""
    by_point = np.argsort(problem.point_index, kind="stable")
    start = np.searchsorted(problem.point_index[by_point], points)
    return np.stack([by_point[start], by_point[start + 1]])


def _of_two_views(problem: Problem, members: NDArray[np.intp]) -> FloatArray:
    """(T, 3) points of two observations (2, T) each."""
    cameras = problem.cameras[problem.camera_index[members]]
    rows = pinhole_rows(problem.intrinsics)[problem.intrinsics_index[problem.camera_index[members]], :PINHOLE]
    pixels = to_pixels(normalised_pixels(problem)[members], rows)
    matrices = fundamental_matrix(cameras[0], cameras[1], rows[0], rows[1])
    moved = _onto_epipolar_lines(matrices, pixels, _sigmas(problem)[members])
    rays = (cameras[..., :3] @ homogeneous(to_normalised(moved, rows))[..., None])[..., 0]
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    return midpoints(rays[0], cameras[0, :, :, 3], rays[1], cameras[1, :, :, 3])


def _sigmas(problem: Problem) -> FloatArray:
    return np.ones(problem.num_observations) if problem.sigma_px is None else problem.sigma_px


def _onto_epipolar_lines(matrices: FloatArray, pixels: FloatArray, sigmas: FloatArray) -> FloatArray:
    """Pixels (2, T, 2) moved by least squares so that ``u₁ᵀ F u₂ = 0``.

    At the minimum ``δ₁ = λ n₁`` and ``δ₂ = λ n₂`` with ``n₁ = F (u₂ − δ₂)``, ``n₂ = Fᵀ (u₁ − δ₁)``, both
    without their third element: each step solves the constraint, quadratic in λ, along the normals of the
    step before. Pixels and matrices are counted in standard deviations.
    """
    scale = np.concatenate([sigmas, np.ones((1, sigmas.shape[1]))])[[[0, 0, 2], [1, 1, 2]]]
    f = matrices * np.moveaxis(scale[0], 0, 1)[:, :, None] * np.moveaxis(scale[1], 0, 1)[:, None, :]
    first, second = (homogeneous(pixels[k] / sigmas[k][:, None]) for k in range(2))
    inner = f[:, :2, :2]
    line_1, line_2 = np.einsum("tij,tj->ti", f, second), np.einsum("tij,ti->tj", f, first)
    start = np.concatenate([line_1[:, :2], line_2[:, :2]], axis=1)
    constraint = (first * line_1).sum(axis=1)
    normals, shift = start, np.zeros_like(start)
    for _ in range(_NUM_STEPS):
        shift = _multiplier(inner, constraint, start, normals)[:, None] * normals
        bent_1 = np.einsum("tij,tj->ti", inner, shift[:, 2:])
        bent_2 = np.einsum("tij,ti->tj", inner, shift[:, :2])
        normals = start - np.concatenate([bent_1, bent_2], axis=1)
    return np.asarray(pixels - sigmas[:, :, None] * np.stack([shift[:, :2], shift[:, 2:]]))


def _multiplier(
    inner: FloatArray, constraint: FloatArray, start: FloatArray, normals: FloatArray
) -> FloatArray:
    """(T,) smaller root of ``a λ² − 2 b λ + c``: how far to go along the normals to meet the constraint."""
    a = np.einsum("ti,tij,tj->t", normals[:, :2], inner, normals[:, 2:])
    b = (normals * start).sum(axis=1) / 2
    root = np.sqrt(np.maximum(b * b - a * constraint, 0.0))
    bottom = b + np.where(b < 0, -root, root)
    return np.asarray(np.divide(constraint, bottom, out=np.zeros_like(b), where=bottom != 0))
