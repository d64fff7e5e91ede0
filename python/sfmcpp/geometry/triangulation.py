"""World points from their images in two or more calibrated cameras, all points at once.

The cameras, intrinsics and observations are those of a problem; its points are not looked at. A point that
its observations leave open, with fewer than two rays or with parallel ones, is not a number.
"""

from __future__ import annotations

import numpy as np

from sfmcpp.geometry._tracks import (
    mean_by_point,
    normalised_pixels,
    num_views,
    observed_rays,
    require_metric,
    sum_by_point,
    sum_outer_by_point,
)
from sfmcpp.model import Problem
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import BoolArray, FloatArray

# Rays are parallel where what holds a point along them is this part of what holds it across: their angle
# is then about 1e-6 rad, far below what a pixel can tell.
_PARALLEL_RATIO = 1e-12
# Centres coincide where their spread is this part of their distance from the origin: rounding.
_SAME_PLACE_RATIO = 1e-14


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
    apart = length > _SAME_PLACE_RATIO * np.linalg.norm(origin, axis=1)
    return np.asarray(apart & (held[:, 0] > _PARALLEL_RATIO * held[:, 2]))


def _nan_unless(good: BoolArray, points: FloatArray) -> FloatArray:
    return np.where(good[:, None], points, np.nan)
