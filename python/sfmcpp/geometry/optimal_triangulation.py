"""World points with the least sum of squared reprojection errors, all points at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sfmcpp.geometry._tracks import normalised_pixels, num_views
from sfmcpp.geometry.epipolar import fundamental_matrix
from sfmcpp.geometry.pinhole import PINHOLE, homogeneous, pinhole_rows, to_normalised, to_pixels
from sfmcpp.geometry.point_refinement import refine_points
from sfmcpp.geometry.triangulation import triangulate_linear
from sfmcpp.geometry.two_rays import midpoints
from sfmcpp.model import Problem
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import FloatArray

# The error of the closed form's two steps is below 1e-6 px for all but absurd noise; more cost little.
_NUM_STEPS = 5


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
