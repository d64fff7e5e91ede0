"""Radial distortion by two coefficients: ``r ↦ r (1 + k1 r² + k2 r⁴)``, and where it can be undone."""

from __future__ import annotations

import math

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import FloatArray

Distortion = tuple[float, float]

NO_DISTORTION: Distortion = (0.0, 0.0)


def distort(offsets: FloatArray, distortion: Distortion) -> FloatArray:
    """Distort image offsets (N, 2), in units of the focal length."""
    k1, k2 = distortion
    squared_radius = (offsets**2).sum(axis=1, keepdims=True)
    distorted: FloatArray = offsets * (1 + squared_radius * (k1 + squared_radius * k2))
    return distorted


def undistorted_radius(radius: float, distortion: Distortion) -> float:
    """The radius that becomes `radius`, both in units of the focal length.

    Raises
    ------
    InvalidArgument
        If the distortion folds the image over before that radius.
    """
    fold = _fold_radius(distortion)
    if math.isfinite(fold) and _distorted(fold, distortion) <= radius:
        raise InvalidArgument(
            f"distortion = {distortion}: folds the image at {_distorted(fold, distortion):.4g} focal lengths "
            f"from its centre, must be invertible up to its corner at {radius:.4g}"
        )
    above = radius
    while above < fold and _distorted(above, distortion) < radius:
        above *= 2
    return _bisected(radius, min(above, fold), distortion)


def _distorted(radius: float, distortion: Distortion) -> float:
    k1, k2 = distortion
    return radius * (1 + radius**2 * (k1 + radius**2 * k2))


def _fold_radius(distortion: Distortion) -> float:
    """Smallest radius where the derivative ``1 + 3 k1 r² + 5 k2 r⁴`` vanishes; infinite if nowhere."""
    k1, k2 = distortion
    discriminant = 9 * k1**2 - 20 * k2
    if discriminant < 0:
        return math.inf
    denominator = math.sqrt(discriminant) - 3 * k1
    return math.sqrt(2 / denominator) if denominator > 0 else math.inf


def _bisected(radius: float, above: float, distortion: Distortion) -> float:
    below = 0.0
    while below < (middle := (below + above) / 2) < above:
        if _distorted(middle, distortion) < radius:
            below = middle
        else:
            above = middle
    return above
