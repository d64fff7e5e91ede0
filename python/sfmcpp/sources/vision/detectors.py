"""Detectors and descriptors: SIFT blobs, and corners in buckets (thesis §3.1.1).

SIFT is OpenCV's (Lowe, "Distinctive image features from scale-invariant keypoints", IJCV 2004). Its scale
space, from twice the size of a 6-megapixel photo down, takes 1.4 GB, and a third of the time goes to fetching
that memory: here the two finest octaves are searched tile by tile, and the others in an image of a quarter of
the size.

Corners are defined in :mod:`sfmcpp.sources.vision.klt`. Unlike a blob a corner has no size of its own; it is
described so that SIFT's matcher takes it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model.arrays import FloatArray
from sfmcpp.sources.vision.images import GreyImage
from sfmcpp.sources.vision.keypoints import HARRIS_K, Keypoints, SearchImage, columns_of, spread_choice

DescriptorArray = NDArray[np.uint8]

_OCTAVE_LAYERS, _FIRST_BLUR_PX, _EDGE_RATIO = 3, 1.6, 10.0
# OpenCV takes an image for blurred by this much [px] already.
_CAMERA_BLUR_PX = 0.5
# Core of a tile [px] at most, and what is seen around it: the descriptor of the largest blob of octave 0
# (σ = 3.4 px) reaches 36 px, and its blur a few more.
_TILE_PX, _MARGIN_PX = 1024, 48
# Octave −1 is the enlarged one. The next after those of tiles is the first of an image smaller by the step.
_LAST_OCTAVE_OF_TILES, _COARSE_STEP = 0, 4
# Candidates that are described, by those that are wanted, in all tiles together.
_CANDIDATES, _LEAST_CANDIDATES = 3.0, 8192
# Part of the features that are the largest blobs there are: they are found again in other photos most often.
# The others are placed most accurately.
_LARGEST = 2 / 3
# Sides of the squares [px] over which the structure tensor is summed, and a corner's place is refined (half).
_BLOCK_PX, _REFINED_HALF_PX = 5, 4
_LEAST_SIDE_PX = 2 * _REFINED_HALF_PX + 5
_MIN_DISTANCE_PX = 4
_FARTHEST_PX = 2.0
# Layer 2 of 3 of octave 0: a blur of 1.6 · 2^(2/3) px, as a SIFT descriptor of that size takes it.
_LAYER, _BLUR_PX = 2, 1.6 * 2 ** (2 / 3)
_ORIENTATION_BLUR_PX = 1.5 * _BLUR_PX


class _Strip(NamedTuple):
    """A stretch of pixels of one axis, its core from `start` to before `end`, and what is seen around it."""

    start: int
    end: int
    seen: slice


class _Settings(NamedTuple):
    at_most: int
    contrast: float


def find_blobs(cv2: ModuleType, image: SearchImage, count: int, contrast: float) -> Keypoints:
    """At most `count` blobs of a response from `contrast` on: the largest, and others spread over it."""
    rows, columns = (_equal_strips(side) for side in image.shape)
    wanted = max(_CANDIDATES * count, _LEAST_CANDIDATES) / (len(rows) * len(columns))
    coarse = count
    if image.mask is not None:
        # What is masked would count among the strongest: all are described, as 0 is no limit.
        wanted = coarse = 0
    parts = [
        _fine_blobs(cv2, image.gray, row, column, _Settings(math.ceil(wanted), contrast))
        for row in rows
        for column in columns
    ]
    parts.append(_coarse_blobs(cv2, image.gray, _Settings(coarse, contrast)))
    found = Keypoints(*map(np.concatenate, zip(*parts, strict=True)))
    found = found.chosen(image.allows(found.pixels))
    by_size = np.lexsort((*found.pixels.T, -found.responses, -found.scales))
    largest, others = np.split(by_size, [math.ceil(_LARGEST * count)])
    rest = found.chosen(others)
    # Of two blobs with equal responses the smaller one is placed more accurately.
    merits = rest.responses / np.sqrt(rest.scales)
    accurate = others[spread_choice(rest.pixels, merits, image.shape, count - len(largest))]
    return found.chosen(np.concatenate([largest, accurate]))


def describe(
    cv2: ModuleType, gray: GreyImage, keypoints: Sequence[Any]
) -> tuple[Sequence[Any], DescriptorArray]:
    """OpenCV's keypoints that can be described, and their descriptors."""
    kept, descriptors = _sift(cv2, _Settings(0, 0.04)).compute(gray, keypoints)
    return kept, descriptors


def _equal_strips(length: int) -> list[_Strip]:
    """Equal parts of an axis of `length` pixels."""
    ends = np.linspace(0, length, math.ceil(length / _TILE_PX) + 1).round().astype(int).tolist()
    return [
        _Strip(start, end, slice(max(0, start - _MARGIN_PX), end + _MARGIN_PX))
        for start, end in pairwise(ends)
    ]


def _fine_blobs(
    cv2: ModuleType, gray: GreyImage, rows: _Strip, columns: _Strip, settings: _Settings
) -> Keypoints:
    """Blobs of the two finest octaves in the core of a tile."""
    tile = np.ascontiguousarray(gray[rows.seen, columns.seen])
    keypoints, descriptors = _sift(cv2, settings).detectAndCompute(tile, None)
    found = columns_of(keypoints, descriptors)
    x, y = found.pixels.T
    found.pixels[:] += (columns.seen.start, rows.seen.start)
    octaves = np.array([k.octave & 255 for k in keypoints], np.uint8).astype(np.int8)
    # The centre of the first pixel is at 0: it reaches from −½ to ½.
    inside = (
        (x >= columns.start - 0.5) & (x < columns.end - 0.5) & (y >= rows.start - 0.5) & (y < rows.end - 0.5)
    )
    return found.chosen(inside & (octaves <= _LAST_OCTAVE_OF_TILES))


def _coarse_blobs(cv2: ModuleType, gray: GreyImage, settings: _Settings) -> Keypoints:
    """Blobs of all other octaves, in every fourth pixel of the image, blurred as much as that asks for."""
    blur = math.sqrt((_COARSE_STEP * _CAMERA_BLUR_PX) ** 2 - _CAMERA_BLUR_PX**2)
    small = np.ascontiguousarray(cv2.GaussianBlur(gray, (0, 0), blur)[::_COARSE_STEP, ::_COARSE_STEP])
    keypoints, descriptors = _sift(cv2, settings).detectAndCompute(small, None)
    found = columns_of(keypoints, descriptors)
    return found._replace(pixels=_COARSE_STEP * found.pixels, scales=_COARSE_STEP * found.scales)


def _sift(cv2: ModuleType, settings: _Settings) -> Any:
    return cv2.SIFT_create(
        settings.at_most,
        _OCTAVE_LAYERS,
        settings.contrast,
        _EDGE_RATIO,
        _FIRST_BLUR_PX,
        descriptorType=cv2.CV_8U,
        enable_precise_upscale=True,
    )


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
    refined = _subpixel_corners(cv2, image.gray, pixels[best])
    angles = _corner_orientations(cv2, image.gray, refined)
    keypoints = [
        cv2.KeyPoint(float(x), float(y), 2 * _BLUR_PX, math.degrees(angle), float(response), _LAYER << 8)
        for (x, y), angle, response in zip(refined, angles, responses[best], strict=True)
    ]
    found = columns_of(*describe(cv2, image.gray, keypoints))
    return found.chosen(image.allows(found.pixels))


def _subpixel_corners(cv2: ModuleType, gray: GreyImage, pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """To where the gradients around a corner point best; one that goes farther than it may stays."""
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.01)
    half = (_REFINED_HALF_PX, _REFINED_HALF_PX)
    moved = cv2.cornerSubPix(gray, pixels.copy(), half, (-1, -1), stop)
    good = (moved >= 0) & (moved <= np.array(gray.shape[::-1]) - 1) & (np.abs(moved - pixels) <= _FARTHEST_PX)
    return np.where(good.all(axis=1, keepdims=True), moved, pixels)


def _corner_orientations(cv2: ModuleType, gray: GreyImage, pixels: NDArray[np.float32]) -> FloatArray:
    """Directions (n,) of the mean gradient around pixels (n, 2), from x towards y [rad], from 0 to 2π."""
    columns, rows = np.rint(pixels).astype(np.int64).T
    slopes = [
        cv2.GaussianBlur(cv2.Sobel(gray, cv2.CV_32F, *order), (0, 0), _ORIENTATION_BLUR_PX)[rows, columns]
        for order in ((1, 0), (0, 1))
    ]
    return np.asarray(np.arctan2(slopes[1], slopes[0]) % (2 * math.pi), dtype=np.float64)
