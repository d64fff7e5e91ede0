"""Tracks that come from elsewhere, as images with features and pairs that share tracks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from sfmcpp.geometry import two_view_geometry
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.image_tracks import ImageTracks
from sfmcpp.model.photos import Features, Photo
from sfmcpp.sfm.match_graph import MatchGraph, Pair
from sfmcpp.sfm.tracks import NO_TRACK, Tracks

# Pairs of images that are looked at, for a start and for the report: those that share most tracks.
_PAIRS_PER_IMAGE = 20


def features_of(tracks: ImageTracks) -> list[Features]:
    """Make each image's features from its observations, in the order of the tracks.

    Parameters
    ----------
    tracks : ImageTracks
        Observations of images.

    Returns
    -------
    list of Features
        Without colours, scales, angles and descriptors.
    """
    result = []
    for image in range(tracks.num_images):
        rows = _rows(tracks, image)
        unknown = np.full(len(rows), np.nan)
        colors, no_descriptors = np.zeros((len(rows), 3), np.uint8), np.zeros((len(rows), 0), np.uint8)
        result.append(Features(tracks.pixels[rows], unknown, unknown, colors, no_descriptors))
    return result


def photos_of(tracks: ImageTracks) -> list[Photo]:
    """Images that are known by their names and sizes alone; see :func:`sizes_of`."""
    sizes = sizes_of(tracks)
    return [
        Photo(name, size=(int(width), int(height)))
        for name, (width, height) in zip(tracks.names, sizes, strict=True)
    ]


def sizes_of(tracks: ImageTracks) -> NDArray[np.int64]:
    """(I, 2) width and height [px]; where unknown, as far as observations reach."""
    known = np.asarray((tracks.sizes > 0).all(axis=1))
    centred = np.asarray((tracks.centres == 0).all(axis=1))
    reach = np.abs(tracks.pixels).max(axis=0, initial=0.5)
    sides = np.ceil(np.where(centred[:, None], 2 * reach, reach)).astype(np.int64)
    return np.where(known[:, None], tracks.sizes, sides)


def joined(tracks: ImageTracks) -> Tracks:
    """Say which features of :func:`features_of` are one track; tracks seen once are none."""
    counts = np.bincount(tracks.image_index, minlength=tracks.num_images)
    begin = np.concatenate([[0], np.cumsum(counts)]).astype(np.intp)
    rows = np.concatenate([np.empty(0, np.intp), *(_rows(tracks, i) for i in range(tracks.num_images))])
    seen = tracks.track_index[rows]
    views = np.bincount(seen, minlength=tracks.num_tracks)
    number = np.full(tracks.num_tracks, NO_TRACK, dtype=np.int32)
    number[views > 1] = np.arange(np.count_nonzero(views > 1), dtype=np.int32)
    return Tracks(begin, number[seen], int(np.count_nonzero(views > 1)), np.empty((0, 2), dtype=np.intp))


def _rows(tracks: ImageTracks, image: int) -> NDArray[np.intp]:
    rows = np.flatnonzero(tracks.image_index == image)
    return rows[np.argsort(tracks.track_index[rows], kind="stable")]


def graph_of_tracks(
    tracks: ImageTracks,
    intrinsics: Sequence[FloatArray | None],
    *,
    seed: int = 0,
    progress: Callable[[str, int, int], bool] = lambda *_: False,
) -> MatchGraph:
    """Make the graph of the images and of those pairs of them that share most tracks.

    Parameters
    ----------
    tracks : ImageTracks
        Observations of images.
    intrinsics : sequence of (12,) float64 or None
        Intrinsics of each image's camera, None where they are not known.
    seed : int
        Of every random sample.
    progress : callable
        Called with the name of the stage and how many pairs are done, of how many; returning True stops.

    Returns
    -------
    MatchGraph
        Its matches are tracks that both images see.

    Raises
    ------
    KeyboardInterrupt
        If `progress` asks to stop.
    """
    features = features_of(tracks)
    numbers = [np.sort(tracks.track_index[tracks.image_index == i]) for i in range(tracks.num_images)]
    chosen = _pairs(tracks)
    pairs = []
    for done, (first, second) in enumerate(chosen, 1):
        _, in_first, in_second = np.intersect1d(
            numbers[first], numbers[second], assume_unique=True, return_indices=True
        )
        matches = np.column_stack([in_first, in_second]).astype(np.int32)
        found = two_view_geometry(
            features[first].pixels[in_first],
            features[second].pixels[in_second],
            intrinsics[first],
            intrinsics[second],
            seed=seed,
        )
        pairs.append(Pair(first, second, matches, found))
        if progress("geometry", done, len(chosen)):
            raise KeyboardInterrupt
    return MatchGraph(photos_of(tracks), features, pairs)


def _pairs(tracks: ImageTracks) -> list[tuple[int, int]]:
    """Pairs that share most tracks: the best of each image."""
    from scipy.sparse import csr_array

    ones = np.ones(len(tracks), dtype=np.int32)
    sees = csr_array((ones, (tracks.image_index, tracks.track_index)), (tracks.num_images, tracks.num_tracks))
    shared = (sees @ sees.T).toarray()
    np.fill_diagonal(shared, 0)
    best = np.argsort(-shared, axis=1, kind="stable")[:, :_PAIRS_PER_IMAGE]
    keep = np.zeros(shared.shape, dtype=np.bool_)
    np.put_along_axis(keep, best, True, axis=1)
    keep = (keep | keep.T) & (shared > 0)
    return [(i, j) for i, j in combinations(range(tracks.num_images), 2) if keep[i, j]]
