"""Isotropic normalisation of images (thesis eq. 4.3): frames in which projective matrices are of one size.

A frame is ``scale, cx, cy``: pixels are ``scale · (x, y) + (cx, cy)``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model.arrays import FloatArray


def image_frames(images: NDArray[np.integer], pixels: FloatArray, count: int) -> FloatArray:
    """Frames (count, 3) of images: the mean of the observations of each, and their mean distance over √2.

    Parameters
    ----------
    images : (M,) int
        Image of each observation.
    pixels : (M, 2) float64
        Where it is [px].
    count : int
        Number of images.
    """
    seen = np.maximum(np.bincount(images, minlength=count), 1)
    centres = np.stack([np.bincount(images, pixels[:, k], count) / seen for k in (0, 1)], axis=1)
    distances = np.linalg.norm(pixels - centres[images], axis=1)
    scale = np.bincount(images, distances, count) / (seen * np.sqrt(2.0))
    return np.concatenate([np.where(scale > 0, scale, 1.0)[:, None], centres], axis=1)


def matrices_to_pixels(matrices: FloatArray, frames: FloatArray) -> FloatArray:
    """Projection matrices (C, 3, 4) to the frames of the images as matrices to pixels."""
    scale, centre = frames[:, 0, None, None], frames[:, 1:, None]
    return np.concatenate([scale * matrices[:, :2] + centre * matrices[:, 2:], matrices[:, 2:]], axis=1)


def matrices_to_frames(matrices: FloatArray, frames: FloatArray) -> FloatArray:
    """Projection matrices (C, 3, 4) to pixels as matrices to the frames of the images."""
    scale, centre = frames[:, 0, None, None], frames[:, 1:, None]
    return np.concatenate([(matrices[:, :2] - centre * matrices[:, 2:]) / scale, matrices[:, 2:]], axis=1)
