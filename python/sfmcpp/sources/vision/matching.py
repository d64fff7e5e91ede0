"""Matching of the features of two images.

A feature matches its nearest neighbour in the other image if that is much nearer than the second nearest
(Lowe, "Distinctive image features from scale-invariant keypoints", IJCV 2004), and if each of the two
is the nearest of the other.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sfmcpp import _core
from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import BoolArray, IndexArray, number_array
from sfmcpp.model.checks import require_count, require_share

Descriptors = NDArray[np.uint8]
# Number of the nearest, squared distances to it and to the second nearest, as the core gives them.
Nearest = tuple[IndexArray, IndexArray, IndexArray]
# Distances from here on stand where there is no second (features/nearest_kernels.hpp): none comes near.
_NO_DISTANCE = 1 << 28


def match(
    descriptors_1: Descriptors,
    descriptors_2: Descriptors,
    *,
    ratio: float = 0.8,
    mutual: bool = True,
    threads: int = 0,
) -> IndexArray:
    """Pairs of descriptors that are alike.

    Parameters
    ----------
    descriptors_1, descriptors_2 : (n, D), (m, D) uint8
        One a row, D ≤ 2048, compared by the Euclidean distance; of equally near ones the first counts.
    ratio : float
        Above a neighbour's distance over that of the second nearest; in both directions where `mutual`.
        At 1 every nearest neighbour passes, as it does where there is no second.
    mutual : bool
        Whether each of a pair must be the nearest of the other; else several may match one.
    threads : int
        How many to use; 0: as many as gain from it. The result is the same.

    Returns
    -------
    (k, 2) int32
        Numbers of rows of the first and of the second, ascending by the first.

    Raises
    ------
    InvalidArgument
        For arrays that are not of bytes or do not go together, and a ratio that is not within 0 and 1.
    """
    first, second = (
        _checked_descriptors("descriptors_1", descriptors_1),
        _checked_descriptors("descriptors_2", descriptors_2),
    )
    if first.shape[1] != second.shape[1]:
        raise InvalidArgument(
            f"descriptors_2: has {second.shape[1]} columns, must have {first.shape[1]} as descriptors_1"
        )
    require_share("ratio", ratio)
    if not isinstance(mutual, bool | np.bool_):
        raise InvalidArgument(f"mutual = {mutual!r}: must be True or False")
    require_count("threads", threads, 0)
    if first.size == 0 or second.size == 0:
        return np.zeros((0, 2), np.int32)
    if not mutual:
        forward = _core.nearest_of_first(first, second, threads)
        kept = _passes_ratio_test(forward, ratio)
    else:
        forward, backward = _core.nearest_both_ways(first, second, threads)
        kept = _passes_ratio_test(forward, ratio) & _passes_ratio_test(backward, ratio)[forward[0]]
        kept &= backward[0][forward[0]] == np.arange(len(first))
    numbers = np.flatnonzero(kept)
    return np.column_stack([numbers, forward[0][numbers]]).astype(np.int32)


def _passes_ratio_test(nearest: Nearest, ratio: float) -> BoolArray:
    """Which neighbours pass the ratio test."""
    _, squared, second = nearest
    return np.asarray((squared < ratio**2 * second) | (second >= _NO_DISTANCE) | (ratio >= 1.0))


def _checked_descriptors(name: str, descriptors: Descriptors) -> Descriptors:
    array = number_array(name, descriptors)
    if array.ndim != 2 or array.dtype != np.uint8:
        raise InvalidArgument(
            f"{name}: is {array.dtype} of shape {array.shape}, must be uint8 of shape (n, D)"
        )
    return np.ascontiguousarray(array)
