"""Types that detectors share: the search image, keypoints as columns, grid cells that spread them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.sources.vision.images import GreyImage

# Harris and Stephens' k in det − k tr².
HARRIS_K = 0.04
# Features that are spread over cells, by cells.
_PER_CELL = 8


def cells_of(pixels: NDArray[Any], shape: tuple[int, int], columns: int, rows: int) -> NDArray[np.int64]:
    """Number of the cell, counted row by row, of each of `pixels` (n, 2) in an image (height, width)."""
    height, width = shape
    column = np.minimum(pixels[:, 0] * columns / width, columns - 1).astype(np.int64)
    row = np.minimum(pixels[:, 1] * rows / height, rows - 1).astype(np.int64)
    return np.asarray(row * columns + column)


def rank_within(groups: NDArray[np.int64]) -> NDArray[np.int64]:
    """How many of the same group come before each."""
    order = np.argsort(groups, kind="stable")
    ordered = groups[order]
    ranks = np.empty(len(groups), dtype=np.int64)
    ranks[order] = np.arange(len(groups)) - np.searchsorted(ordered, ordered)
    return ranks


@dataclass(frozen=True, eq=False)
class SearchImage:
    """Grey levels (height, width) and where something may be detected: of the same shape, or all."""

    gray: GreyImage
    mask: BoolArray | None

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        return self.gray.shape[0], self.gray.shape[1]

    def allows(self, pixels: FloatArray) -> BoolArray:
        """Whether something may be detected at each of (n, 2)."""
        if self.mask is None:
            return np.ones(len(pixels), np.bool_)
        columns, rows = np.rint(pixels).astype(np.int64).T
        height, width = self.shape
        return np.asarray(self.mask[rows.clip(0, height - 1), columns.clip(0, width - 1)])


class Keypoints(NamedTuple):
    """Columns of what was detected; the centre of the top left pixel is at (0, 0), as OpenCV has it."""

    pixels: FloatArray
    scales: FloatArray
    angles: FloatArray
    responses: FloatArray
    descriptors: NDArray[np.uint8]

    def chosen(self, which: NDArray[Any]) -> Keypoints:
        """Some of them, in that order."""
        return Keypoints(*(column[which] for column in self))


def columns_of(keypoints: Sequence[Any], descriptors: NDArray[np.uint8] | None) -> Keypoints:
    """OpenCV's keypoints, whose sizes are diameters and whose angles are degrees from x towards y."""
    rows = [(*k.pt, k.size / 2, math.radians(k.angle), k.response) for k in keypoints]
    table = np.array(rows, dtype=np.float64).reshape(-1, 5)
    if descriptors is None:
        descriptors = np.empty((0, 128), np.uint8)
    return Keypoints(table[:, :2], table[:, 2], table[:, 3], table[:, 4], descriptors)


def spread_choice(
    pixels: FloatArray, merits: FloatArray, shape: tuple[int, int], count: int
) -> NDArray[np.int64]:
    """Which `count` to keep, the best first.

    One half are the best of each cell of a grid, equally many of each as far as it has them; the other half
    are the best of what is left, which mostly are where there is most texture.
    """
    best_first = np.lexsort((*pixels.T, -merits))
    if len(best_first) <= count or not count:
        return best_first[:count]
    cell_px = math.sqrt(_PER_CELL * math.prod(shape) / (count / 2))
    rows, columns = (math.ceil(side / cell_px) for side in shape)
    ranks = rank_within(cells_of(pixels[best_first], shape, columns, rows))
    kept = np.zeros(len(best_first), np.bool_)
    kept[np.argsort(ranks, kind="stable")[: count // 2]] = True
    kept[np.flatnonzero(~kept)[: count - count // 2]] = True
    return best_first[kept]
