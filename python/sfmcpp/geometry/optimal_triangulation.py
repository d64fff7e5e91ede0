"""World points from two views each, optimal for Gaussian noise on the pixels, all points at once."""

from __future__ import annotations

import dataclasses

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry._tracks import intrinsics_of_observations, num_views, require_metric
from sfmcpp.geometry.epipolar import fundamental_matrix
from sfmcpp.geometry.pinhole import homogeneous
from sfmcpp.geometry.triangulation import triangulate_midpoint
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray

_MAX_STEPS = 20
_TOLERANCE = 1e-12


def correct_matches(
    fundamental: FloatArray, pixels_1: FloatArray, pixels_2: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Move matches onto the epipolar geometry, by the smallest sum of squared distances.

    The minimum of ``‖Δ₁‖² + ‖Δ₂‖²`` with ``(x₁ − Δ₁)ᵀ F (x₂ − Δ₂) = 0`` has ``Δ₁ = λ n₁`` and ``Δ₂ = λ n₂``,
    where n₁ and n₂ are the normals of the epipolar lines at the corrected points. Each step takes the
    normals from the last points and the smaller root λ of the constraint along them (after Lindstrom 2010,
    whose method stops at the second step).

    Parameters
    ----------
    fundamental : (3, 3) or (N, 3, 3) float64
        See :func:`sfmcpp.geometry.epipolar.fundamental_matrix`.
    pixels_1, pixels_2 : (N, 2) float64
        Image positions [px].

    Returns
    -------
    corrected_1, corrected_2 : (N, 2) float64
        Positions [px] whose rays meet.
    """
    f = np.broadcast_to(fundamental, (len(pixels_1), 3, 3))
    normal_1, normal_2 = first_1, first_2 = _normals(f, pixels_1, pixels_2)
    algebraic = np.einsum("ni,nij,nj->n", homogeneous(pixels_1), f, homogeneous(pixels_2))
    length = np.zeros(len(f))
    for _ in range(_MAX_STEPS):
        last = length
        length = _smaller_root(f, normal_1, normal_2, first_1, first_2, algebraic)
        corrected = pixels_1 - length[:, None] * normal_1, pixels_2 - length[:, None] * normal_2
        if (np.abs(length - last) <= _TOLERANCE * np.abs(length)).all():
            break
        normal_1, normal_2 = _normals(f, *corrected)
    return corrected


def _normals(f: FloatArray, pixels_1: FloatArray, pixels_2: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Normals (N, 2) of the epipolar line of each point's partner, in image 1 and in image 2."""
    line_1 = np.einsum("nij,nj->ni", f, homogeneous(pixels_2))
    line_2 = np.einsum("nji,nj->ni", f, homogeneous(pixels_1))
    return line_1[:, :2], line_2[:, :2]


def _smaller_root(
    f: FloatArray,
    normal_1: FloatArray,
    normal_2: FloatArray,
    first_1: FloatArray,
    first_2: FloatArray,
    algebraic: FloatArray,
) -> FloatArray:
    """Root λ of ``a λ² − 2 b λ + c``: the constraint at the pixels moved by −λ along the normals."""
    a = np.einsum("ni,nij,nj->n", normal_1, f[:, :2, :2], normal_2)
    b = ((normal_1 * first_1).sum(axis=1) + (normal_2 * first_2).sum(axis=1)) / 2
    root = np.sqrt(np.maximum(b * b - a * algebraic, 0.0))
    denominator = b + np.copysign(root, b)
    length: FloatArray = np.divide(algebraic, denominator, out=np.zeros_like(b), where=denominator != 0)
    return length


def triangulate_optimal(problem: Problem) -> FloatArray:
    """Triangulate points seen twice each, by the smallest sum of squared reprojection errors.

    The pixels are corrected (:func:`correct_matches`) so that the two rays of each point meet there.

    Parameters
    ----------
    problem : Problem
        Of the camera model ``"calibrated"``, with exactly two observations of each of its N points; their
        standard deviations are taken as equal.

    Returns
    -------
    (N, 3) float64
        Not a number where rays are parallel or centres coincide.

    Raises
    ------
    InvalidArgument
        If the problem has another camera model, numbers that are not finite or indices out of range, or a
        point not seen twice.
    """
    require_metric(problem)
    _require_two_views(problem)
    first, second = np.argsort(problem.point_index, kind="stable").reshape(-1, 2).T
    cameras, intrinsics = problem.cameras[problem.camera_index], intrinsics_of_observations(problem)
    f = fundamental_matrix(cameras[first], cameras[second], intrinsics[first], intrinsics[second])
    pixels = np.empty_like(problem.pixels)
    pixels[first], pixels[second] = correct_matches(f, problem.pixels[first], problem.pixels[second])
    return triangulate_midpoint(dataclasses.replace(problem, pixels=pixels))


def _require_two_views(problem: Problem) -> None:
    views = num_views(problem)
    if (views != 2).any():
        worst = int(np.argmax(views != 2))
        raise InvalidArgument(f"problem: point {worst} has {views[worst]} observations, must be 2")
