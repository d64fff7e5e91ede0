"""The calibrated camera without its pose: pixels from and to normalised image points.

With intrinsics ``(f, aspect, cx, cy, skew)``: ``u = f x + skew y + cx``, ``v = aspect f y + cy``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import FloatArray, finite_array


def intrinsics_row(name: str, value: ArrayLike) -> FloatArray:
    """`value` as ``(f, aspect, cx, cy, skew)``, or InvalidArgument."""
    row = finite_array(name, value, (5,))
    for index, part in enumerate(("f", "aspect")):
        if row[index] <= 0:
            raise InvalidArgument(f"{name}[{index}] = {row[index]}: {part} must be positive")
    return row


def to_normalised(pixels: FloatArray, intrinsics: FloatArray) -> FloatArray:
    """Image points ``(x, y)`` at depth one of pixels.

    Parameters
    ----------
    pixels : (..., 2) float64
        Image positions [px].
    intrinsics : (5,) or (..., 5) float64
        One row for all, or one for each pixel.

    Returns
    -------
    (..., 2) float64
    """
    f, aspect, cx, cy, skew = np.moveaxis(intrinsics, -1, 0)
    y = (pixels[..., 1] - cy) / (aspect * f)
    x = (pixels[..., 0] - cx - skew * y) / f
    return np.stack([x, y], axis=-1)


def to_pixels(normalised: FloatArray, intrinsics: FloatArray) -> FloatArray:
    """Pixels of image points ``(x, y)`` at depth one: the inverse of :func:`to_normalised`.

    Parameters
    ----------
    normalised : (..., 2) float64
        Image points at depth one.
    intrinsics : (5,) or (..., 5) float64
        One row for all, or one for each point.

    Returns
    -------
    (..., 2) float64
        Image positions [px].
    """
    f, aspect, cx, cy, skew = np.moveaxis(intrinsics, -1, 0)
    x, y = normalised[..., 0], normalised[..., 1]
    return np.stack([f * x + skew * y + cx, aspect * f * y + cy], axis=-1)


def mean_focal_px(intrinsics: FloatArray) -> float:
    """Mean of the focal lengths along u and v [px] of one row of intrinsics."""
    return float(intrinsics[0] * (1 + intrinsics[1]) / 2)


def homogeneous(points: FloatArray) -> FloatArray:
    """Append a one: (..., D) to (..., D + 1)."""
    return np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1)


def unit(vectors: FloatArray) -> FloatArray:
    """Vectors (..., D) scaled to length one; those of length zero stay."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    scaled: FloatArray = vectors / np.where(lengths > 0, lengths, 1.0)
    return scaled


def inverse_calibration(intrinsics: FloatArray) -> FloatArray:
    """``K⁻¹`` (..., 3, 3) of rows of intrinsics (..., 5): from pixels (u, v, 1) to (x, y, 1)."""
    f, aspect, cx, cy, skew = np.moveaxis(intrinsics, -1, 0)
    inverse = np.zeros((*intrinsics.shape[:-1], 3, 3))
    inverse[..., 0, 0] = 1 / f
    inverse[..., 1, 1] = 1 / (aspect * f)
    inverse[..., 0, 1] = -skew / (f * aspect * f)
    inverse[..., 0, 2] = skew * cy / (f * aspect * f) - cx / f
    inverse[..., 1, 2] = -cy / (aspect * f)
    inverse[..., 2, 2] = 1.0
    return inverse
