"""Fundamental matrix and homography from matches with outliers, cameras unknown (thesis §3.1.4)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry._poselib import RansacOptions, fundamental_by_ransac, homography_by_ransac
from sfmcpp.geometry.epipolar import sampson_errors_px
from sfmcpp.geometry.pinhole import homogeneous, inverse_calibration
from sfmcpp.geometry.significance import (
    chance_near_line,
    chance_near_point,
    least_significant,
    samples_needed,
)
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import BoolArray, FloatArray, finite_array
from sfmcpp.model.checks import require_count

EIGHT_POINTS, SEVEN_POINTS, FOUR_POINTS = 8, 7, 4


def homography_errors_px(
    homography: FloatArray,
    pixels_1: FloatArray,
    pixels_2: FloatArray,
    slopes_1: FloatArray | None = None,
    slopes_2: FloatArray | None = None,
) -> FloatArray:
    """First-order distance of matches from a homography: the Sampson error of its two equations.

    With the offset ``e = u₂ − H(u₁)`` and the slope A of H at u₁ it is ``√(eᵀ (I + A Aᵀ)⁻¹ e)``.

    Parameters
    ----------
    homography : (3, 3) float64
        ``(u₂, v₂, 1) ∝ H (u₁, v₁, 1)``.
    pixels_1, pixels_2 : (N, 2) float64
        Image positions [px], distortion taken out.
    slopes_1, slopes_2 : (N, 2, 2) float64, optional
        Their derivatives with respect to the positions seen, in which the distance is measured. Default:
        there is no distortion.

    Returns
    -------
    (N,) float64
        Distance in the joint space of both images [px]; infinite where H turns the image inside out, which no
        plane does that both cameras see from the same side.
    """
    mapped = homogeneous(pixels_1) @ homography.T
    scale = mapped[:, 2]
    # The determinant of the slope is det H / scale³.
    upright = scale * (homography[0] @ np.cross(homography[1], homography[2])) > 0
    scale = np.where(upright, scale, 1.0)
    image = mapped[:, :2] / scale[:, None]
    slope = (homography[:2, :2] - image[:, :, None] * homography[2, :2]) / scale[:, None, None]
    if slopes_1 is not None:
        slope = slope @ slopes_1
    spread = slope @ np.swapaxes(slope, 1, 2)
    spread += np.eye(2) if slopes_2 is None else slopes_2 @ np.swapaxes(slopes_2, 1, 2)
    return np.where(upright, _mahalanobis(pixels_2 - image, spread), np.inf)


def _mahalanobis(offsets: FloatArray, spread: FloatArray) -> FloatArray:
    """(N,) ``√(eᵀ S⁻¹ e)`` of offsets (N, 2) and matrices (N, 2, 2)."""
    x, y = offsets.T
    a, b, d = spread[:, 0, 0], spread[:, 0, 1], spread[:, 1, 1]
    with np.errstate(divide="ignore", invalid="ignore"):  # rounding may leave no determinant: not near
        squares = (d * x * x - 2 * b * x * y + a * y * y) / (a * d - b * b)
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)))


def normalised_homography(
    homography: FloatArray, intrinsics_1: FloatArray, intrinsics_2: FloatArray
) -> FloatArray:
    """``K₂⁻¹ H K₁`` (3, 3): the homography between image points at depth one."""
    calibration_1 = np.linalg.inv(inverse_calibration(intrinsics_1))
    return np.asarray(inverse_calibration(intrinsics_2) @ homography @ calibration_1)


@dataclass(frozen=True)
class MatrixEstimate:
    """A 3×3 matrix between two images from matches with outliers, or why there is none.

    Attributes
    ----------
    matrix : (3, 3) float64
        Of norm one; not a number after a failure.
    inliers : (N,) bool
        Matches that agree with it; none after a failure.
    message : str
        Why there is none, with the numbers at fault; empty without a failure.
    """

    matrix: FloatArray
    inliers: BoolArray
    message: str

    @property
    def success(self) -> bool:
        """Whether the matrix can be used."""
        return not self.message

    @property
    def num_inliers(self) -> int:
        """Number of matches that agree with the matrix."""
        return int(np.count_nonzero(self.inliers))


def fundamental_from_matches(
    pixels_1: ArrayLike,
    pixels_2: ArrayLike,
    *,
    threshold_px: float = 2.0,
    min_inliers: int = 15,
    confidence: float = 0.9999,
    max_iterations: int = 10_000,
    seed: int = 0,
) -> MatrixEstimate:
    """Estimate a fundamental matrix: seven points in adaptive LO-RANSAC, refined on the inliers (PoseLib).

    The refinement minimises robust Sampson errors with damped Gauss–Newton steps (thesis §3.1.4). It fails
    where no more matches agree than would by chance. Points near a plane leave the matrix open; see
    :func:`sfmcpp.geometry.two_view_geometry`, which tells.

    Parameters
    ----------
    pixels_1, pixels_2 : (N, 2) float64
        Images of the same N points in both photos [px].
    threshold_px : float
        Largest Sampson error of an inlier [px].
    min_inliers : int
        Fewest inliers of a matrix to trust, at least 8.
    confidence : float
        Asked probability of having drawn one sample without outliers.
    max_iterations : int
        Samples at most.
    seed : int
        Same seed, same result.

    Returns
    -------
    MatrixEstimate
        ``F`` with ``(u₁, v₁, 1) F (u₂, v₂, 1)ᵀ = 0``, of rank two.

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a number is not finite or out of its range.
    ModuleNotFoundError
        If PoseLib is not installed (extra ``vision``).
    """
    first, second = _checked(pixels_1, pixels_2)
    require_count("min_inliers", min_inliers, SEVEN_POINTS + 1)
    options = RansacOptions(threshold_px, confidence, max_iterations, seed)
    return significant_fundamental(first, second, options, min_inliers)


def homography_from_matches(
    pixels_1: ArrayLike,
    pixels_2: ArrayLike,
    *,
    threshold_px: float = 2.0,
    min_inliers: int = 15,
    confidence: float = 0.9999,
    max_iterations: int = 10_000,
    seed: int = 0,
) -> MatrixEstimate:
    """Estimate a homography: four points in adaptive LO-RANSAC, refined on the inliers (PoseLib).

    It fails where no more matches agree than would by chance.

    Parameters
    ----------
    pixels_1, pixels_2 : (N, 2) float64
        Images of the same N points in both photos [px].
    threshold_px : float
        Largest first-order distance of an inlier [px]; see
        :func:`sfmcpp.geometry.two_view_matrices.homography_errors_px`.
    min_inliers : int
        Fewest inliers of a matrix to trust, at least 5.
    confidence : float
        Asked probability of having drawn one sample without outliers.
    max_iterations : int
        Samples at most.
    seed : int
        Same seed, same result.

    Returns
    -------
    MatrixEstimate
        ``H`` with ``(u₂, v₂, 1) ∝ H (u₁, v₁, 1)``.

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a number is not finite or out of its range.
    ModuleNotFoundError
        If PoseLib is not installed (extra ``vision``).
    """
    first, second = _checked(pixels_1, pixels_2)
    require_count("min_inliers", min_inliers, FOUR_POINTS + 1)
    options = RansacOptions(threshold_px, confidence, max_iterations, seed)
    return significant_homography(first, second, options, min_inliers)


@checked(pixels_1=("n", 2), pixels_2=("n", 2))
def fundamental_linear(pixels_1: FloatArray, pixels_2: FloatArray) -> FloatArray:
    """Fundamental matrix by linear least squares over all matches: the normalised eight-point algorithm.

    R. Hartley, "In defense of the eight-point algorithm", PAMI 1997.

    Parameters
    ----------
    pixels_1, pixels_2 : (N, 2) float64
        Images of the same points in both photos [px], N ≥ 8, without outliers.

    Returns
    -------
    (3, 3) float64
        ``F`` with ``(u₁, v₁, 1) F (u₂, v₂, 1)ᵀ = 0``, of norm one and rank two.

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a number is not finite, or there are fewer than eight matches.
    """
    pixels_1, pixels_2 = _checked(pixels_1, pixels_2)
    if len(pixels_1) < EIGHT_POINTS:
        raise InvalidArgument(f"pixels_1: {len(pixels_1)} matches, must be at least {EIGHT_POINTS}")
    scaling_1, scaling_2 = _isotropic_normalisation(pixels_1), _isotropic_normalisation(pixels_2)
    x_1, x_2 = homogeneous(pixels_1) @ scaling_1.T, homogeneous(pixels_2) @ scaling_2.T
    rows = (x_1[:, :, None] * x_2[:, None, :]).reshape(-1, 9)
    u, d, vt = np.linalg.svd(np.linalg.eigh(rows.T @ rows)[1][:, 0].reshape(3, 3))
    d[2] = 0.0
    matrix = scaling_1.T @ (u * d) @ vt @ scaling_2
    return np.asarray(matrix / np.linalg.norm(matrix))


def significant_fundamental(
    pixels_1: FloatArray, pixels_2: FloatArray, options: RansacOptions, min_inliers: int
) -> MatrixEstimate:
    """Implementation of :func:`fundamental_from_matches`, for checked arguments."""
    chance = chance_near_line(pixels_1, pixels_2, options.threshold_px)
    least = max(min_inliers, least_significant(len(pixels_1), SEVEN_POINTS, chance))
    return _estimate(
        pixels_1, pixels_2, options, least, SEVEN_POINTS, fundamental_by_ransac, sampson_errors_px
    )


def significant_homography(
    pixels_1: FloatArray, pixels_2: FloatArray, options: RansacOptions, min_inliers: int
) -> MatrixEstimate:
    """Implementation of :func:`homography_from_matches`, for checked arguments."""
    chance = chance_near_point(pixels_1, pixels_2, options.threshold_px)
    least = max(min_inliers, least_significant(len(pixels_1), FOUR_POINTS, chance))
    return _estimate(
        pixels_1, pixels_2, options, least, FOUR_POINTS, homography_by_ransac, homography_errors_px
    )


def _checked(pixels_1: ArrayLike, pixels_2: ArrayLike) -> tuple[FloatArray, FloatArray]:
    first = finite_array("pixels_1", pixels_1, (-1, 2))
    return first, finite_array("pixels_2", pixels_2, (len(first), 2))


def _estimate(
    pixels_1: FloatArray,
    pixels_2: FloatArray,
    options: RansacOptions,
    least: int,
    sample_size: int,
    search: Callable[[FloatArray, FloatArray, RansacOptions], FloatArray],
    errors_px: Callable[[FloatArray, FloatArray, FloatArray], FloatArray],
) -> MatrixEstimate:
    count = len(pixels_1)
    if count < least:
        return _failed(count, f"{count} matches: must be at least {least}")
    matrix = search(pixels_1, pixels_2, with_sample_limit(options, least / count, sample_size))
    inliers = np.asarray(errors_px(matrix, pixels_1, pixels_2) <= options.threshold_px)
    if np.count_nonzero(inliers) < least:
        return _failed(count, f"{np.count_nonzero(inliers)} inliers: must be at least {least}")
    return MatrixEstimate(matrix, inliers, "")


def with_sample_limit(options: RansacOptions, ratio: float, sample_size: int) -> RansacOptions:
    """`options` that search no longer than it takes to find a model of that inlier ratio."""
    most = samples_needed(ratio, sample_size, options.confidence, options.max_iterations)
    return replace(options, max_iterations=most)


def _failed(count: int, message: str) -> MatrixEstimate:
    return MatrixEstimate(np.full((3, 3), np.nan), np.zeros(count, dtype=np.bool_), message)


def _isotropic_normalisation(pixels: FloatArray) -> FloatArray:
    """(3, 3) that moves the mean of `pixels` to the origin and their mean squared distance from it to 2."""
    mean = pixels.mean(axis=0)
    spread = np.sqrt(((pixels - mean) ** 2).sum(axis=1).mean() / 2)
    scale = 1 / spread if spread > 0 else 1.0
    return np.array([[scale, 0, -scale * mean[0]], [0, scale, -scale * mean[1]], [0, 0, 1.0]])
