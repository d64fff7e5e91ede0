"""Where two rays come nearest to each other."""

from __future__ import annotations

import numpy as np

from sfmcpp.model.arrays import FloatArray


def closest_depths(
    rays_1: FloatArray, rays_2: FloatArray, baselines: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Depths at which lines come nearest to each other, times a number that is not negative (thesis eq. 3.3).

    Parameters
    ----------
    rays_1, rays_2 : (..., 3) float64
        Directions of the lines, of any length, which is the unit of the depths.
    baselines : (..., 3) float64
        From where the first starts to where the second does.

    Returns
    -------
    depth_1, depth_2, factor : (...) float64
        The depths are ``depth_1 / factor`` and ``depth_2 / factor``. The factor is the squared sine of the
        angle between the lines, times the squares of both lengths: zero, or rounding, for parallel ones.
    """
    square_1, square_2, across = dot(rays_1, rays_1), dot(rays_2, rays_2), dot(rays_1, rays_2)
    along_1, along_2 = dot(rays_1, baselines), dot(rays_2, baselines)
    depth_1 = square_2 * along_1 - across * along_2
    depth_2 = across * along_1 - square_1 * along_2
    return depth_1, depth_2, square_1 * square_2 - across**2


def midpoints(
    rays_1: FloatArray, centres_1: FloatArray, rays_2: FloatArray, centres_2: FloatArray
) -> FloatArray:
    """Middle (..., 3) of the shortest connection of two lines each (thesis eq. 3.2).

    Parameters
    ----------
    rays_1, rays_2 : (..., 3) float64
        Directions of the lines.
    centres_1, centres_2 : (..., 3) float64
        Where they start.

    Returns
    -------
    (..., 3) float64
        Not a number, or infinite, for parallel lines.
    """
    depth_1, depth_2, factor = closest_depths(rays_1, rays_2, centres_2 - centres_1)
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = centres_1 + (depth_1 / factor)[..., None] * rays_1
        ends += centres_2 + (depth_2 / factor)[..., None] * rays_2
    return np.asarray(ends / 2)


def dot(one: FloatArray, other: FloatArray) -> FloatArray:
    """Scalar products (...) of vectors (..., 3)."""
    return np.asarray(np.einsum("...i,...i->...", one, other))
