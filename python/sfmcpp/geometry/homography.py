"""How far matches are from a homography, and the cameras that see a plane by one."""

from __future__ import annotations

import numpy as np

from sfmcpp.geometry.pinhole import homogeneous, inverse_calibration
from sfmcpp.model.arrays import FloatArray


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
    squares = (d * x * x - 2 * b * x * y + a * y * y) / (a * d - b * b)
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)))


def normalised_homography(
    homography: FloatArray, intrinsics_1: FloatArray, intrinsics_2: FloatArray
) -> FloatArray:
    """``K₂⁻¹ H K₁`` (3, 3): the homography between image points at depth one."""
    calibration_1 = np.linalg.inv(inverse_calibration(intrinsics_1))
    return np.asarray(inverse_calibration(intrinsics_2) @ homography @ calibration_1)
