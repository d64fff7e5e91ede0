"""Rows of text from columns of numbers, formatted in C rather than row by row, and their order."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import InvalidArgument
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray

_CHUNK_ROWS = 1 << 14
_SEPARATOR = "\0"

Column = NDArray[Any] | Sequence[str]


def format_rows(template: str, *columns: Column) -> Iterator[str]:
    """Rows ``template % (a[i], b[i], …)`` one after another, some thousands at a time.

    ``%r`` writes a float with the fewest digits that read back as the same float.
    """
    for start in range(0, len(columns[0]), _CHUNK_ROWS):
        parts = [_listed(column[start : start + _CHUNK_ROWS]) for column in columns]
        yield template * len(parts[0]) % tuple(chain.from_iterable(zip(*parts, strict=True)))


def format_strings(template: str, *columns: Column) -> list[str]:
    """Row by row what :func:`format_rows` writes; no column may hold a NUL."""
    text = "".join(format_rows(template + _SEPARATOR, *columns))
    return text.split(_SEPARATOR)[:-1]


def ragged_text(heads: Sequence[str], items: Sequence[str], counts: NDArray[np.int64]) -> str:
    """Each head followed by its items; `items` lie in the order of the heads, ``counts[i]`` for head i."""
    pieces = np.empty(len(heads) + len(items), dtype=object)
    is_head = np.zeros(len(pieces), dtype=np.bool_)
    is_head[np.arange(len(heads)) + exclusive_sums(counts)] = True
    pieces[is_head] = heads
    pieces[~is_head] = items
    return "".join(pieces.tolist())


def exclusive_sums(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Sum of all counts before each one."""
    return np.cumsum(counts) - counts


def by_point(problem: Problem) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Order (M,) that groups the observations by point, otherwise unchanged, and how many each point has."""
    order = np.argsort(problem.point_index, kind="stable")
    return order, np.bincount(problem.point_index, minlength=problem.num_points)


def keypoint_ranks(problem: Problem) -> NDArray[np.int64]:
    """Give each observation its number (M,) among those of its camera, from 0."""
    order = np.argsort(problem.camera_index, kind="stable")
    counts = np.bincount(problem.camera_index, minlength=problem.num_cameras)
    ranks = np.empty(problem.num_observations, dtype=np.int64)
    ranks[order] = np.arange(len(order)) - np.repeat(exclusive_sums(counts), counts)
    return ranks


def tokens_of_items(first: NDArray[np.int64], counts: NDArray[np.int64], width: int) -> NDArray[np.int64]:
    """First number of each item, where list i starts at number ``first[i]`` and has ``counts[i]`` items."""
    within = np.arange(int(counts.sum())) - np.repeat(exclusive_sums(counts), counts)
    return np.asarray(np.repeat(first, counts) + width * within)


def _listed(column: Column) -> Sequence[Any]:
    return column.tolist() if isinstance(column, np.ndarray) else column


def all_keypoints(problem: Problem) -> tuple[NDArray[np.int64], FloatArray, NDArray[np.int64]]:
    """Keypoints of all images, image after image, those that see no point among them.

    Parameters
    ----------
    problem : Problem
        Its metadata may number the keypoints of each image, and hold those without a point.

    Returns
    -------
    counts : (C,) int64
        How many each image has.
    pixels : (K, 2) float64
        Where they are [px].
    rows : (M,) int64
        The keypoint of each observation.

    Raises
    ------
    InvalidArgument
        If the metadata do not fit the problem.
    """
    extra = problem.metadata.extra
    loose = np.asarray(extra.get("colmap_loose_image", np.empty(0, np.int64)))
    ranks = np.asarray(extra.get("colmap_keypoint_index", keypoint_ranks(problem)))
    if len(ranks) != problem.num_observations:
        raise InvalidArgument(
            f"metadata colmap_keypoint_index has {len(ranks)} entries: must be {problem.num_observations}"
        )
    image = np.concatenate([problem.camera_index, loose])
    index = np.concatenate([ranks, extra.get("colmap_loose_keypoint_index", np.empty(0, np.int64))])
    counts = np.bincount(image, minlength=problem.num_cameras)
    place = exclusive_sums(counts)[image] + index
    if ((index < 0) | (index >= counts[image])).any() or len(np.unique(place)) != len(place):
        raise InvalidArgument("metadata colmap_keypoint_index does not number each image's keypoints once")
    pixels = np.empty((len(place), 2))
    pixels[place] = np.concatenate([problem.pixels, extra.get("colmap_loose_pixels", np.empty((0, 2)))])
    return counts, pixels, place[: problem.num_observations]
