"""Rows of text formatted by the core from columns of numbers, and the order of observations in files."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp import _core
from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray, IndexArray, as_stored, index_array
from sfmcpp.model.metadata import KEYPOINTS, LOOSE, require_entries
from sfmcpp.sources.io.checks import LARGEST_COUNT, require_metadata_length

_CHUNK_ROWS = 1 << 17
_FIELD = re.compile("%([drs])")

Column = NDArray[Any] | Sequence[str]
Some = slice | NDArray[np.int64]


@dataclass(frozen=True)
class Rows:
    """Rows of text ``template % (a[i], b[i], …)``.

    ``%d`` writes an integer, ``%s`` a text without NUL, ``%r`` a float with the fewest characters that read
    back as the same float.
    """

    template: str
    columns: Sequence[Column] = ()

    def fields(self, some: Some) -> tuple[list[tuple[str, NDArray[Any]]], str]:
        """Columns of some rows, each with the text before it, and the text after the last one."""
        *fields, after = _FIELD.split(self.template)
        pairs = zip(fields[::2], fields[1::2], self.columns, strict=True)
        return [(before, _converted_column(kind, column, some)) for before, kind, column in pairs], after


def format_rows(template: str, *columns: Column) -> Iterator[bytes]:
    """One row of :class:`Rows` after another, some thousands at a time."""
    yield from format_ragged(Rows(template, columns), Rows(""), np.zeros(len(columns[0]), dtype=np.int64))


def format_ragged(
    head: Rows,
    item: Rows,
    counts: NDArray[np.int64],
    tail: str = "",
    order: NDArray[np.int64] | None = None,
) -> Iterator[bytes]:
    """Each head, its items and a tail, some thousands at a time.

    The items lie in the order of the heads, or in `order`; ``counts[i]`` are of head i.
    """
    ends = np.cumsum(counts)
    rows = ends + np.arange(1, len(ends) + 1)
    cuts = np.searchsorted(rows, np.arange(_CHUNK_ROWS, rows[-1] if len(rows) else 0, _CHUNK_ROWS)) + 1
    first = 0
    for begin, end in pairwise(np.unique([0, *cuts, len(ends)]).tolist()):
        among = slice(first, int(ends[end - 1]))
        first = among.stop
        heads, items = head.fields(slice(begin, end)), item.fields(among if order is None else order[among])
        yield _core.ragged_text(*heads, *items, tail, counts[begin:end])


def exclusive_sums(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Sum of all counts before each one."""
    return np.cumsum(counts) - counts


def by_point(problem: Problem) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Order (M,) that groups the observations by point, otherwise unchanged, and how many each point has."""
    counts = np.bincount(problem.point_index, minlength=problem.num_points)
    order = np.empty(problem.num_observations, dtype=np.int64)
    ranks = _core.group_ranks(problem.point_index, problem.num_points)
    order[exclusive_sums(counts)[problem.point_index] + ranks] = np.arange(len(order))
    return order, counts


def keypoint_ranks(problem: Problem) -> NDArray[np.int64]:
    """Give each observation its number (M,) among those of its camera, from 0."""
    return _core.group_ranks(problem.camera_index, problem.num_cameras)


def observation_keys(problem: Problem, name: str, path: Path) -> NDArray[Any]:
    """Number (M,) of each observation in its image: of the metadata of that name, or else counted."""
    keys = problem.metadata.extra.get(name)
    keys = keypoint_ranks(problem) if keys is None else np.asarray(keys)
    require_metadata_length(name, keys, problem.num_observations, path)
    if ((keys < 0) | (keys > LARGEST_COUNT)).any():
        raise DatasetError(path, f"metadata {name}: every key number must be from 0 to {LARGEST_COUNT}")
    return keys


def tokens_of_items(first: NDArray[np.int64], counts: NDArray[np.int64], width: int) -> NDArray[np.int64]:
    """First number of each item, where list i starts at number ``first[i]`` and has ``counts[i]`` items."""
    within = np.arange(int(counts.sum())) - np.repeat(exclusive_sums(counts), counts)
    return np.asarray(np.repeat(first, counts) + width * within)


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
    require_entries(extra)
    loose = _images_of_loose_keypoints(problem)
    ranks = index_array(f"metadata {KEYPOINTS}", extra.get(KEYPOINTS, keypoint_ranks(problem)))
    if len(ranks) != problem.num_observations:
        raise InvalidArgument(
            f"metadata {KEYPOINTS} has {len(ranks)} entries: must be {problem.num_observations}"
        )
    image = _with_more(problem.camera_index, loose)
    _, name, of_pixels = LOOSE
    index = _with_more(ranks, index_array(f"metadata {name}", extra.get(name, ())))
    counts = np.bincount(image, minlength=problem.num_cameras)
    place = exclusive_sums(counts).take(image) + index
    if ((index < 0) | (index >= counts.take(image))).any() or (order := _inverse(place)).min(initial=0) < 0:
        raise InvalidArgument(f"metadata {KEYPOINTS} does not number each image's keypoints once")
    pixels = _with_more(problem.pixels, extra.get(of_pixels, np.empty((0, 2))))
    return counts, pixels.take(order, axis=0), place[: problem.num_observations]


def _with_more(rows: NDArray[Any], more: NDArray[Any]) -> NDArray[Any]:
    """Rows and more rows in one array, which is no copy where there are no more."""
    return np.concatenate([rows, more]) if len(more) else rows


def _images_of_loose_keypoints(problem: Problem) -> IndexArray:
    """The image of each keypoint that sees no point; room is made for every image that is named."""
    name = LOOSE[0]
    loose = index_array(f"metadata {name}", problem.metadata.extra.get(name, ()))
    if len(loose) and not 0 <= loose.min() <= loose.max() < problem.num_cameras:
        raise InvalidArgument(f"metadata {name}: must be from 0 to {problem.num_cameras - 1}")
    return loose


def _inverse(places: NDArray[np.int64]) -> NDArray[np.int64]:
    """Where each of the numbers 0, 1, … is in `places`, of which none is larger than they are many; or −1."""
    order = np.full(len(places), -1)
    order[places] = np.arange(len(places))
    return order


_DTYPES = {"d": np.int64, "r": np.float64}


def _converted_column(kind: str, column: Column, some: Some) -> NDArray[Any]:
    if kind == "s":
        return np.array([text.encode("utf-8") for text in np.asarray(column, dtype=object)[some]], dtype="S")
    return as_stored(np.asarray(column)[some], _DTYPES[kind])
