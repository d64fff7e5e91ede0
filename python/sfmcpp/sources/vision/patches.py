"""Patches of photos: sampled in a pyramid of grey levels, and aligned to others to a part of a pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sfmcpp import _core
from sfmcpp.model.arrays import FloatArray, IndexArray, as_stored
from sfmcpp.model.photos import Photo
from sfmcpp.sources.vision.images import load_cv2
from sfmcpp.sources.vision.photos import read_gray

Samples = NDArray[np.float32]
Pyramid = list[Samples]

_LEVELS = 7
_LEAST_SIDE_PX = 32


@dataclass(frozen=True, eq=False)
class PatchAlignment:
    """Result of aligning templates to an image.

    Attributes
    ----------
    pixels : (n, 2) float64
        Positions of the templates' centres [px].
    correlations : (n,) float64
        How alike they are, at most 1; -1 where nothing near the start looks alike.
    covariances : (n, 3) float64
        Σ_uu, Σ_uv, Σ_vv of the positions [px²], from what the image and the template do not have in common.
    """

    pixels: FloatArray
    correlations: FloatArray
    covariances: FloatArray


def grey_pyramid(photo: Photo) -> Pyramid:
    """Grey levels of a photo, and of copies that are smaller by a factor of two each.

    Parameters
    ----------
    photo : Photo
        One with a file.

    Returns
    -------
    list of (height, width) float32
        The photo first.

    Raises
    ------
    DatasetError
        If the photo cannot be decoded.
    """
    return pyramid_of(read_gray(photo))


def pyramid_of(gray: NDArray[np.uint8]) -> Pyramid:
    """Like :func:`grey_pyramid`, of grey levels (height, width) that are at hand."""
    levels = [gray.astype(np.float32)]
    while len(levels) < _LEVELS and min(levels[-1].shape) >= 2 * _LEAST_SIDE_PX:
        levels.append(load_cv2().pyrDown(levels[-1]))
    return levels


def sample_patches(pyramid: Pyramid, pixels: FloatArray, steps: FloatArray, radius: int) -> Samples:
    """Sample square patches of an image.

    Parameters
    ----------
    pyramid : list of (height, width) float32
        What :func:`grey_pyramid` gives.
    pixels : (n, 2) float64
        Centres of the patches [px].
    steps : (n, 2, 2) float64
        How the position changes with the sample's column (first column) and row (second column) [px]. Steps
        of more than a pixel are made in smaller copies, whose blur suits them.
    radius : int
        Samples on each side of the centre.

    Returns
    -------
    (n, 2 radius + 1, 2 radius + 1) float32
        Rows of grey levels; not a number where a patch is not all within the image.

    Raises
    ------
    InvalidArgument
        If a shape or the radius breaks a rule.
    """
    level = _levels_for(pyramid, steps)
    return _core.sample_patches(pyramid, _contiguous(pixels), _contiguous(steps), level, radius)


def align_patches(
    pyramid: Pyramid, templates: Samples, which: IndexArray, pixels: FloatArray, steps: FloatArray
) -> PatchAlignment:
    """Align templates to an image, independently of brightness and contrast.

    Parameters
    ----------
    pyramid : list of (height, width) float32
        What :func:`grey_pyramid` gives.
    templates : (T, S, S) float32
        What :func:`sample_patches` gives; the outermost samples serve for gradients alone.
    which : (n,) int32
        Template of each patch.
    pixels : (n, 2) float64
        Where to start [px]; places farther away than 2.5 samples are not found.
    steps : (n, 2, 2) float64
        As of :func:`sample_patches`.

    Returns
    -------
    PatchAlignment
        One row for each patch.

    Raises
    ------
    InvalidArgument
        If a shape breaks a rule, or there is no such template.
    """
    level = _levels_for(pyramid, steps)
    which = as_stored(which, np.int32)
    found = _core.align_patches(pyramid, templates, which, _contiguous(pixels), _contiguous(steps), level)
    return PatchAlignment(*found)


def _levels_for(pyramid: Pyramid, steps: FloatArray) -> IndexArray:
    """(n,) level whose pixels are nearest to the mean step."""
    (a, b), (c, d) = np.moveaxis(steps, 0, -1)
    size = np.sqrt(np.abs(a * d - b * c))
    level = np.rint(np.log2(np.fmax(size, 1.0)))
    return np.asarray(level.clip(0, len(pyramid) - 1), dtype=np.int32)


def _contiguous(array: FloatArray) -> FloatArray:
    return as_stored(array, np.float64)
