"""Projective depths by epipolar geometry, chained over images.

P. Sturm, B. Triggs, ECCV 1996; D. Martinec, T. Pajdla, CVPR 2005.
"""

from __future__ import annotations

import numpy as np

from sfmcpp.model.arrays import FloatArray


def chained_depths(
    rays: FloatArray, fundamentals: dict[tuple[int, int], FloatArray], parents: list[int]
) -> FloatArray:
    """Depths of tracks that all images of a block see (thesis eq. 3.21), each from those of its parent.

    Parameters
    ----------
    rays : (s, n, 3) float64
        Homogeneous positions.
    fundamentals : dict
        ``qₐᵀ F q_b = 0`` by the places (a, b), a < b, of the images in the block.
    parents : list of int
        Place of the image from which each takes its depths, an earlier one; that of the first is not used.

    Returns
    -------
    (s, n) float64
        Up to a factor for each image; those of the first image are one.
    """
    depths = np.ones(rays.shape[:2])
    for place, parent in enumerate(parents[1:], start=1):
        swapped = parent < place
        matrix = fundamentals[min(place, parent), max(place, parent)]
        matrix = matrix.T if swapped else matrix
        ratio = depth_ratios(matrix, rays[place], rays[parent])
        depths[place] = ratio * depths[parent]
        depths[place] /= np.median(np.abs(depths[place]))
    return depths


def depth_ratios(fundamental: FloatArray, rays_1: FloatArray, rays_2: FloatArray) -> FloatArray:
    """λ₁/λ₂ (n,) of matches, up to a common factor (thesis eq. 3.21).

    ``λ₁ (e × q₁) = λ₂ F q₂`` with the epipole e of camera 2 in image 1, ``eᵀ F = 0``.
    """
    epipole = np.linalg.svd(fundamental)[0][:, 2]
    across = np.cross(epipole, rays_1)
    length = (across**2).sum(axis=1)
    along = (across * (rays_2 @ fundamental.T)).sum(axis=1)
    return np.asarray(along / np.maximum(length, np.finfo(np.float64).tiny))
