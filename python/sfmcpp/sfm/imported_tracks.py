"""Match graphs from tracks of other programs: features, and pairs of images that share tracks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model.arrays import BoolArray, FloatArray, IndexArray
from sfmcpp.model.image_tracks import ImageTracks
from sfmcpp.model.photos import Photo
from sfmcpp.model.threads import Progress, no_progress
from sfmcpp.sfm.imported_matches import match_graph_of_arrays
from sfmcpp.sfm.match_graph import MatchGraph
from sfmcpp.sfm.tracks import NO_TRACK, Tracks

# Pairs of images that are looked at, for a start and for the report: those that share most tracks.
_PAIRS_PER_IMAGE = 20


def photos_of(tracks: ImageTracks) -> list[Photo]:
    """Images that are known by their names and sizes alone; see :func:`sizes_of`."""
    sizes = sizes_of(tracks)
    return [
        Photo(name, size=(int(width), int(height)))
        for name, (width, height) in zip(tracks.names, sizes, strict=True)
    ]


def from_corner(tracks: ImageTracks) -> ImageTracks:
    """Tracks whose pixels count from the corner of their image, as models have them that are written.

    Where they count from the middle of an image of unknown size, it is as large as observations reach.
    """
    centred = _are_centred(tracks)
    if not centred.any():
        return tracks
    sizes = np.where(centred[:, None], sizes_of(tracks), tracks.sizes)
    centres = np.where(centred[:, None], sizes / 2.0, tracks.centres)
    shift = np.where(centred[:, None], centres, 0.0)
    return replace(tracks, sizes=sizes, centres=centres, pixels=tracks.pixels + shift[tracks.image_index])


def _are_centred(tracks: ImageTracks) -> BoolArray:
    """(I,) whether pixels of an image count from its middle."""
    return np.asarray((tracks.centres == 0).all(axis=1))


def sizes_of(tracks: ImageTracks) -> NDArray[np.int64]:
    """(I, 2) width and height [px]; where unknown, as far as observations reach."""
    known = np.asarray((tracks.sizes > 0).all(axis=1))
    centred = _are_centred(tracks)
    reach = np.abs(tracks.pixels).max(axis=0, initial=0.5)
    sides = np.ceil(np.where(centred[:, None], 2 * reach, reach)).astype(np.int64)
    return np.where(known[:, None], tracks.sizes, sides)


def joined_tracks(tracks: ImageTracks) -> Tracks:
    """Tracks of the features of :func:`graph_of_tracks`, without tracks that are seen once."""
    order, begin = _sorted_by_image(tracks)
    seen = tracks.track_index[order]
    views = np.bincount(seen, minlength=tracks.num_tracks)
    count = int(np.count_nonzero(views > 1))
    number = np.full(tracks.num_tracks, NO_TRACK, dtype=np.int32)
    number[views > 1] = np.arange(count, dtype=np.int32)
    return Tracks(begin, number[seen], count, np.empty((0, 2), dtype=np.intp))


def _sorted_by_image(tracks: ImageTracks) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Observations image after image, within one by their tracks (M,), and where each begins (I + 1,)."""
    order = np.lexsort((tracks.track_index, tracks.image_index))
    counts = np.bincount(tracks.image_index, minlength=tracks.num_images)
    return order, np.concatenate([[0], np.cumsum(counts)]).astype(np.intp)


def graph_of_tracks(
    tracks: ImageTracks,
    intrinsics: Sequence[FloatArray | None],
    *,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress = no_progress,
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
    threads : int, optional
        As of :func:`match_graph_of_arrays`.
    progress : callable
        As of :func:`match_graph_of_arrays`.

    Returns
    -------
    MatchGraph
        Features of an image are its observations in the order of the tracks; matches are tracks that both
        images see.

    Raises
    ------
    KeyboardInterrupt
        If `progress` asks to stop.
    """
    order, begin = _sorted_by_image(tracks)
    rows = np.split(order, begin[1:-1])
    seen = [tracks.track_index[some] for some in rows]
    return match_graph_of_arrays(
        [tracks.pixels[some] for some in rows],
        {(i, j): _common_tracks(seen[i], seen[j]) for i, j in _best_pairs(tracks)},
        sizes_of(tracks),
        tracks.names,
        intrinsics=intrinsics,
        seed=seed,
        threads=threads,
        progress=progress,
    )


def _common_tracks(first: IndexArray, second: IndexArray) -> NDArray[np.intp]:
    """(m, 2) places of the tracks that stand in both, ascending."""
    _, *places = np.intersect1d(first, second, assume_unique=True, return_indices=True)
    return np.column_stack(places)


def _best_pairs(tracks: ImageTracks) -> list[tuple[int, int]]:
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
