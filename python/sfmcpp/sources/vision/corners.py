"""Corners in buckets, the strongest of each (thesis §3.1.1), described so that SIFT's matcher takes them.

What a corner is: see :mod:`sfmcpp.sources.vision.klt`. Unlike a blob it has no size of its own.
"""

from __future__ import annotations

import math
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model.arrays import FloatArray
from sfmcpp.sources.vision.buckets import HARRIS_K
from sfmcpp.sources.vision.images import GreyImage
from sfmcpp.sources.vision.keypoints import Keypoints, SearchImage, columns_of, spread_choice
from sfmcpp.sources.vision.sift import describe

# Sides of the squares [px] over which the structure tensor is summed, and a corner's place is refined (half).
_BLOCK_PX, _REFINED_HALF_PX = 5, 4
_LEAST_SIDE_PX = 2 * _REFINED_HALF_PX + 5
_MIN_DISTANCE_PX = 4
_FARTHEST_PX = 2.0
# Layer 2 of 3 of octave 0: a blur of 1.6 · 2^(2/3) px, as a SIFT descriptor of that size takes it.
_LAYER, _BLUR_PX = 2, 1.6 * 2 ** (2 / 3)
_ORIENTATION_BLUR_PX = 1.5 * _BLUR_PX


def find_corners(cv2: ModuleType, image: SearchImage, kind: str, count: int, quality: float) -> Keypoints:
    """At most `count` corners, spread over the image, strongest first."""
    if min(image.shape) < _LEAST_SIDE_PX:
        return columns_of([], None)
    harris = kind == "harris"
    mask = None if image.mask is None else image.mask.astype(np.uint8)
    places, responses = cv2.goodFeaturesToTrackWithQuality(
        image.gray,
        0,
        quality**2 if harris else quality,
        _MIN_DISTANCE_PX,
        mask,
        blockSize=_BLOCK_PX,
        useHarrisDetector=harris,
        k=HARRIS_K,
    )
    if places is None or not len(places):
        return columns_of([], None)
    pixels, responses = places.reshape(-1, 2), np.ravel(responses).astype(np.float64)
    best = spread_choice(pixels.astype(np.float64), responses, image.shape, count)
    refined = _refined(cv2, image.gray, pixels[best])
    angles = _orientations(cv2, image.gray, refined)
    keypoints = [
        cv2.KeyPoint(float(x), float(y), 2 * _BLUR_PX, math.degrees(angle), float(response), _LAYER << 8)
        for (x, y), angle, response in zip(refined, angles, responses[best], strict=True)
    ]
    found = columns_of(*describe(cv2, image.gray, keypoints))
    return found.chosen(image.allows(found.pixels))


def _refined(cv2: ModuleType, gray: GreyImage, pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """To where the gradients around a corner point best; one that goes farther than it may stays."""
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.01)
    half = (_REFINED_HALF_PX, _REFINED_HALF_PX)
    moved = cv2.cornerSubPix(gray, pixels.copy(), half, (-1, -1), stop)
    good = (moved >= 0) & (moved <= np.array(gray.shape[::-1]) - 1) & (np.abs(moved - pixels) <= _FARTHEST_PX)
    return np.where(good.all(axis=1, keepdims=True), moved, pixels)


def _orientations(cv2: ModuleType, gray: GreyImage, pixels: NDArray[np.float32]) -> FloatArray:
    """Of the mean gradient around each of (n, 2), from x towards y [rad], from 0 to 2π."""
    columns, rows = np.rint(pixels).astype(np.int64).T
    slopes = [
        cv2.GaussianBlur(cv2.Sobel(gray, cv2.CV_32F, *order), (0, 0), _ORIENTATION_BLUR_PX)[rows, columns]
        for order in ((1, 0), (0, 1))
    ]
    return np.asarray(np.arctan2(slopes[1], slopes[0]) % (2 * math.pi), dtype=np.float64)
