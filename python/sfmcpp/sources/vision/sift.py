"""SIFT: blobs of any size and orientation, and how they look.

It is OpenCV's (Lowe, "Distinctive image features from scale-invariant keypoints", IJCV 2004). Its scale
space, from twice the size of a 6-megapixel photo down, takes 1.4 GB, and a third of the time goes to fetching
that memory: here the two finest octaves are searched tile by tile, and the others in an image of a quarter of
the size.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sfmcpp.sources.vision.images import GreyImage
from sfmcpp.sources.vision.keypoints import Keypoints, SearchImage, columns_of, spread_choice

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
    rows, columns = (_strips(side) for side in image.shape)
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


def _strips(length: int) -> list[_Strip]:
    """Equal parts of an axis of `length` pixels."""
    ends = np.linspace(0, length, math.ceil(length / _TILE_PX) + 1).round().astype(int).tolist()
    return [
        _Strip(start, end, slice(max(0, start - _MARGIN_PX), end + _MARGIN_PX))
        for start, end in pairwise(ends)
    ]


def _fine_blobs(
    cv2: ModuleType, gray: GreyImage, rows: _Strip, columns: _Strip, settings: _Settings
) -> Keypoints:
    """Those of the two finest octaves in the core of a tile."""
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
    """Those of all other octaves, in every fourth pixel of the image, blurred as much as that asks for."""
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
