"""Projection without the pose: pixels from and to normalised image points, with or without distortion.

With intrinsics ``(f, aspect, cx, cy, skew)``: ``u = f x + skew y + cx``, ``v = aspect f y + cy``. Seven
more numbers, ``(k1, …, k5, p1, p2)``, distort (x, y) before: see :class:`sfmcpp.model.CameraModel`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sfmcpp import _core
from sfmcpp.errors import InvalidArgument
from sfmcpp.model import camera_model
from sfmcpp.model.arrays import ANY, FloatArray, as_stored, finite_array
from sfmcpp.model.camera_models import PERSPECTIVE

PINHOLE = len(camera_model("calibrated").intrinsics)
_DISTORTED = len(PERSPECTIVE)
_BAL = len(camera_model("bal").intrinsics)


def intrinsics_row(name: str, value: ArrayLike) -> FloatArray:
    """`value` as (5,) intrinsics without distortion or (12,) with, or InvalidArgument.

    It may be a row of the camera model ``"calibrated"``, ``"perspective"`` or ``"bal"``.
    """
    row = finite_array(name, value, (ANY,))
    if len(row) not in (PINHOLE, _DISTORTED, _BAL):
        raise InvalidArgument(f"{name}: shape {row.shape}, must be (5), or with distortion (12) or (3)")
    row = pinhole_rows(row)
    for index, part in enumerate(("f", "aspect")):
        if row[index] <= 0:
            raise InvalidArgument(f"{name}[{index}] = {row[index]}: {part} must be positive")
    return row


def pinhole_rows(intrinsics: FloatArray) -> FloatArray:
    """Intrinsics (..., K) of a metric camera model as (..., 12), or (..., 5) where none distorts."""
    if intrinsics.shape[-1] == _BAL:
        rows = np.zeros((*intrinsics.shape[:-1], _DISTORTED))
        rows[..., 0], rows[..., 1] = intrinsics[..., 0], 1.0
        rows[..., PINHOLE : PINHOLE + 2] = intrinsics[..., 1:]
        intrinsics = rows
    return intrinsics if intrinsics[..., PINHOLE:].any() else intrinsics[..., :PINHOLE]


def to_normalised(pixels: FloatArray, intrinsics: FloatArray) -> FloatArray:
    """Image points ``(x, y)`` at depth one of pixels.

    Parameters
    ----------
    pixels : (..., 2) float64
        Image positions [px].
    intrinsics : (5,) or (..., 5) float64, or with distortion 12 instead of 5
        One row for all, or one for each pixel.

    Returns
    -------
    (..., 2) float64
    """
    if intrinsics.shape[-1] > PINHOLE:
        flat, rows = pixels.reshape(-1, 2), intrinsics.reshape(-1, _DISTORTED)
        index = np.arange(len(flat)) if len(rows) == len(flat) else np.zeros(len(flat), dtype=np.intp)
        pixels = undistorted_pixels(flat, rows, index).reshape(pixels.shape)
    f, aspect, cx, cy, skew = np.moveaxis(intrinsics, -1, 0)[:PINHOLE]
    y = (pixels[..., 1] - cy) / (aspect * f)
    x = (pixels[..., 0] - cx - skew * y) / f
    return np.stack([x, y], axis=-1)


def undistorted_pixels(pixels: FloatArray, rows: FloatArray, index: NDArray[np.integer]) -> FloatArray:
    """Undistort `pixels` (M, 2) of cameras ``rows[index]``, of rows (G, 12).

    Beyond the range in which a lens is invertible pixels stay as they are.
    """
    cameras, count = len(rows), len(pixels)
    arrays = {
        "camera_model": "perspective",
        "cameras": np.tile(np.eye(3, 4), (cameras, 1, 1)),
        "intrinsics": as_stored(rows, np.float64),
        "intrinsics_index": np.arange(cameras, dtype=np.int32),
        "points": np.zeros((1, 3)),
        "camera_index": as_stored(index, np.int32),
        "point_index": np.zeros(count, dtype=np.int32),
        "pixels": as_stored(pixels, np.float64),
        "sigma_px": None,
        "covariance_px2": None,
        "fixed_cameras": np.zeros(cameras, dtype=np.bool_),
        "fixed_points": np.zeros(1, dtype=np.bool_),
        "fixed_intrinsics": np.ones(rows.shape, dtype=np.bool_),
    }
    return np.asarray(_core.undistorted_pixels(arrays))


def to_pixels(normalised: FloatArray, intrinsics: FloatArray) -> FloatArray:
    """Pixels of image points ``(x, y)`` at depth one: the inverse of :func:`to_normalised`.

    Parameters
    ----------
    normalised : (..., 2) float64
        Image points at depth one.
    intrinsics : (5,) or (..., 5) float64, or with distortion 12 instead of 5
        One row for all, or one for each point.

    Returns
    -------
    (..., 2) float64
        Image positions [px].
    """
    f, aspect, cx, cy, skew = np.moveaxis(intrinsics, -1, 0)[:PINHOLE]
    x, y = normalised[..., 0], normalised[..., 1]
    if intrinsics.shape[-1] > PINHOLE:
        radial, _, p1, p2 = _lens(normalised, intrinsics)
        r2 = x * x + y * y
        x, y = (
            radial * x + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            radial * y + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        )
    return np.stack([f * x + skew * y + cx, aspect * f * y + cy], axis=-1)


def image_slopes(normalised: FloatArray, intrinsics: FloatArray) -> FloatArray:
    """Derivatives (..., 2, 2) of :func:`to_pixels` with respect to the image points (..., 2)."""
    f, aspect, _, _, skew = np.moveaxis(intrinsics, -1, 0)[:PINHOLE]
    slopes = np.zeros((*normalised.shape[:-1], 2, 2))
    slopes[..., 0, 0], slopes[..., 0, 1], slopes[..., 1, 1] = f, skew, aspect * f
    if intrinsics.shape[-1] == PINHOLE:
        return slopes
    x, y = normalised[..., 0], normalised[..., 1]
    radial, radial_slope, p1, p2 = _lens(normalised, intrinsics)
    distorted = np.empty_like(slopes)
    distorted[..., 0, 0] = radial + 2 * radial_slope * x * x + 2 * p1 * y + 6 * p2 * x
    distorted[..., 1, 1] = radial + 2 * radial_slope * y * y + 6 * p1 * y + 2 * p2 * x
    distorted[..., 0, 1] = 2 * radial_slope * x * y + 2 * p1 * x + 2 * p2 * y
    distorted[..., 1, 0] = distorted[..., 0, 1]
    return np.asarray(slopes @ distorted)


def _lens(
    normalised: FloatArray, intrinsics: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """``1 + k1 r² + … + k5 r¹⁰``, its derivative with respect to r², p1 and p2."""
    r2 = (normalised**2).sum(axis=-1)
    *radial, p1, p2 = np.moveaxis(intrinsics[..., PINHOLE:], -1, 0)
    value, slope = np.zeros_like(r2), np.zeros_like(r2)
    for k in [*radial[::-1], np.float64(1.0)]:
        value, slope = value * r2 + k, slope * r2 + value
    return value, slope, p1, p2


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
