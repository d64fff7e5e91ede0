"""Matches between two cameras of known intrinsics, and their errors for a relative pose."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.geometry.epipolar import fundamental_matrix, in_front_of_both, sampson_errors_px
from sfmcpp.geometry.pinhole import (
    PINHOLE,
    homogeneous,
    image_slopes,
    intrinsics_row,
    mean_focal_px,
    to_normalised,
    to_pixels,
    unit,
)
from sfmcpp.geometry.rotation_fit import angles_rad, fit_rotation
from sfmcpp.model.arrays import BoolArray, FloatArray, finite_array

_FIRST_CAMERA = np.eye(3, 4)


@dataclass(frozen=True)
class Matches:
    """Images of the same points in two cameras, the first of which is at the origin.

    Attributes
    ----------
    pixels_1, pixels_2 : (N, 2) float64
        Where lenses without distortion would have seen them [px].
    intrinsics_1, intrinsics_2 : (5,) float64
        ``(f, aspect, cx, cy, skew)`` of each camera.
    slopes_1, slopes_2 : (N, 2, 2) float64 or None
        Derivatives of these positions with respect to those seen; None without distortion.
    """

    pixels_1: FloatArray
    pixels_2: FloatArray
    intrinsics_1: FloatArray
    intrinsics_2: FloatArray
    slopes_1: FloatArray | None = None
    slopes_2: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.pixels_1)

    @property
    def arrays(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Pixels and intrinsics of both cameras."""
        return self.pixels_1, self.pixels_2, self.intrinsics_1, self.intrinsics_2

    @property
    def normalised(self) -> tuple[FloatArray, FloatArray]:
        """(N, 2) image points at depth one in each camera."""
        first = to_normalised(self.pixels_1, self.intrinsics_1)
        return first, to_normalised(self.pixels_2, self.intrinsics_2)

    @property
    def rays(self) -> tuple[FloatArray, FloatArray]:
        """(N, 3) unit vectors in the frame of each camera."""
        x_1, x_2 = self.normalised
        return unit(homogeneous(x_1)), unit(homogeneous(x_2))

    @property
    def focal_px(self) -> float:
        """Mean focal length of both cameras [px]."""
        return (mean_focal_px(self.intrinsics_1) + mean_focal_px(self.intrinsics_2)) / 2

    def fit_rotation(self, max_parallax_px: float, seed: int) -> FloatArray:
        """Rotation of the second camera that explains most matches to within that parallax."""
        return fit_rotation(*self.rays, max_parallax_px / self.focal_px, seed)

    def parallax_px(self, rotation: FloatArray) -> FloatArray:
        """Motion of each match that `rotation` does not explain [px]."""
        return angles_rad(*self.rays, rotation) * self.focal_px

    def inliers(self, camera: FloatArray, threshold_px: float) -> BoolArray:
        """Matches that agree with the second camera being `camera`."""
        return np.asarray(self.errors_px(camera) <= threshold_px)

    def errors_px(self, camera: FloatArray) -> FloatArray:
        """(N,) Sampson errors [px] of a second `camera`; infinite for points not in front of both."""
        f = fundamental_matrix(_FIRST_CAMERA, camera, self.intrinsics_1, self.intrinsics_2)
        in_front = in_front_of_both(_FIRST_CAMERA, camera, *self.normalised)
        errors = sampson_errors_px(f, self.pixels_1, self.pixels_2, self.slopes_1, self.slopes_2)
        return np.where(in_front, errors, np.inf)

    def select(self, chosen: BoolArray) -> Matches:
        """Some of the matches."""
        names = ("pixels_1", "pixels_2", "slopes_1", "slopes_2")
        arrays = {name: getattr(self, name) for name in names}
        return replace(self, **{name: a[chosen] for name, a in arrays.items() if a is not None})


def checked_matches(
    pixels_1: ArrayLike, pixels_2: ArrayLike, intrinsics_1: ArrayLike, intrinsics_2: ArrayLike | None
) -> Matches:
    """Matches of valid arrays, or InvalidArgument; the second camera's intrinsics are the first's if None."""
    first = finite_array("pixels_1", pixels_1, (-1, 2))
    second = finite_array("pixels_2", pixels_2, (len(first), 2))
    row_1 = intrinsics_row("intrinsics_1", intrinsics_1)
    row_2 = row_1 if intrinsics_2 is None else intrinsics_row("intrinsics_2", intrinsics_2)
    first, slopes_1 = _undistorted_with_slopes(first, row_1)
    second, slopes_2 = _undistorted_with_slopes(second, row_2)
    return Matches(first, second, row_1[:PINHOLE], row_2[:PINHOLE], slopes_1, slopes_2)


def _undistorted_with_slopes(pixels: FloatArray, row: FloatArray) -> tuple[FloatArray, FloatArray | None]:
    """Pixels without the distortion of the lens, and their derivatives with respect to those with it."""
    if len(row) == PINHOLE:
        return pixels, None
    at = to_normalised(pixels, row)
    pinhole = row[:PINHOLE]
    return to_pixels(at, pinhole), image_slopes(at, pinhole) @ np.linalg.inv(image_slopes(at, row))
