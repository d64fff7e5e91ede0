"""Cells of a grid over an image, so that what is detected covers all of it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

# Harris and Stephens' k in det − k tr².
HARRIS_K = 0.04


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
