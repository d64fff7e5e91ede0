"""Tracks: keypoints of many images that show one scene point, joined by union–find (thesis §3.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model.arrays import IndexArray
from sfmcpp.sfm.match_graph import MatchGraph

NO_TRACK = -1
Links = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Tracks:
    """Which keypoints show the same point.

    Attributes
    ----------
    begin : (I + 1,) int
        First keypoint of each image, all images' keypoints counted on; last, their number.
    track : (K,) int32
        Track of each keypoint, counted from 0 in the order of their first keypoints, or -1.
    count : int
        Number of tracks.
    apart : (e, 2) int
        Matches, as keypoints, that would have joined two tracks that one image sees both.
    """

    begin: Links
    track: IndexArray
    count: int
    apart: Links


class TrackMembers:
    """Keypoints of tracks: what is asked of some tracks costs what they have, however many there are.

    Parameters
    ----------
    track : (K,) int32
        Track of each keypoint, or -1.
    count : int
        Number of tracks.
    """

    def __init__(self, track: IndexArray, count: int) -> None:
        self._rows = np.argsort(track, kind="stable")
        self._begin = np.searchsorted(track, np.arange(count + 1), sorter=self._rows)

    def of(self, tracks: NDArray[np.integer]) -> Links:
        """Keypoints of `tracks` (n,), each of which is there once; in their order."""
        begin, counts = self._begin[tracks], self._begin[tracks + 1] - self._begin[tracks]
        places = np.repeat(begin + counts - np.cumsum(counts), counts) + np.arange(counts.sum())
        return np.sort(self._rows[places])


def build_tracks(graph: MatchGraph) -> Tracks:
    """Join the verified matches of all pairs into tracks of which no image sees one twice.

    Where the matches of a component would let one image see the point twice, they are joined one by one,
    those of the pairs with most inliers first, and a match that would break the rule is set apart.

    Parameters
    ----------
    graph : MatchGraph
        Images, features and pairs.

    Returns
    -------
    Tracks
        Each seen by two images at least.
    """
    counts = np.array([len(features) for features in graph.features], dtype=np.intp)
    begin = np.concatenate([[0], np.cumsum(counts)]).astype(np.intp)
    links, strength = _match_links(graph, begin)
    image = np.repeat(np.arange(len(counts)), counts)
    parts = connected_parts(links, len(image))
    twice = _components_with_conflict(parts, image)
    doubtful = twice[parts[links[:, 0]]]
    kept, apart = _join_without_conflict(links[doubtful], strength[doubtful], image)
    track = _numbered_components(connected_parts(np.concatenate([links[~doubtful], kept]), len(image)))
    differ = track[apart[:, 0]] != track[apart[:, 1]]
    return Tracks(begin, track, int(track.max(initial=NO_TRACK)) + 1, apart[differ].astype(np.intp))


def _match_links(graph: MatchGraph, begin: Links) -> tuple[IndexArray, IndexArray]:
    """(e, 2) keypoints of all verified matches, and the inliers of their pairs (e,): many, so of 32 bits."""
    pairs, first = [pair for pair in graph.pairs if pair.geometry.kind != "none"], begin.astype(np.int32)
    links = [pair.verified + first[[pair.first, pair.second]] for pair in pairs]
    strength = [np.full(len(some), len(some), dtype=np.int32) for some in links]
    empty = np.empty(0, dtype=np.int32)
    return np.concatenate([np.empty((0, 2), dtype=np.int32), *links]), np.concatenate([empty, *strength])


def connected_parts(links: NDArray[np.integer], count: int) -> NDArray[np.int32]:
    """(count,) a number for each of `count` things, the same for those that links (e, 2) connect."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    ones = np.ones(len(links))
    graph = csr_array((ones, (links[:, 0], links[:, 1])), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int32)


def _components_with_conflict(parts: NDArray[np.int32], image: Links) -> NDArray[np.bool_]:
    """Which components have two keypoints of one image."""
    key = np.sort(parts.astype(np.int64) * (image.max(initial=0) + 1) + image)
    repeated = key[1:][np.diff(key) == 0] // (image.max(initial=0) + 1)
    twice = np.zeros(int(parts.max(initial=-1)) + 1, dtype=np.bool_)
    twice[repeated] = True
    return twice


def _join_without_conflict(
    links: IndexArray, strength: IndexArray, image: Links
) -> tuple[IndexArray, IndexArray]:
    """Links that join, and those set apart; the strongest come first."""
    order = np.argsort(-strength, kind="stable")
    keypoints, ends = np.unique(links[order], return_inverse=True)
    root = list(range(len(keypoints)))
    own, sees = image[keypoints].tolist(), dict[int, set[int]]()
    joins = np.zeros(len(links), dtype=np.bool_)
    for place, (first, second) in zip(order.tolist(), ends.reshape(-1, 2).tolist(), strict=True):
        a, b = _root_of(root, first), _root_of(root, second)
        of_a, of_b = sees.get(a) or {own[a]}, sees.get(b) or {own[b]}
        joins[place] = a == b or of_a.isdisjoint(of_b)
        if joins[place] and a != b:
            if len(of_a) < len(of_b):
                a, b, of_a, of_b = b, a, of_b, of_a
            root[b] = a
            of_a |= of_b
            sees[a] = of_a
            sees.pop(b, None)
    return links[joins], links[~joins]


def _root_of(root: list[int], place: int) -> int:
    """Follow `root` to its end, and shorten the way."""
    while (above := root[place]) != place:
        root[place] = root[above]
        place = above
    return place


def _numbered_components(parts: NDArray[np.int32]) -> IndexArray:
    """Number the components of two keypoints and more in the order of their first keypoints."""
    _, first, inverse, counts = np.unique(parts, return_index=True, return_inverse=True, return_counts=True)
    joined = counts > 1
    order = np.argsort(first[joined], kind="stable")
    number = np.full(len(first), NO_TRACK, dtype=np.int32)
    number[np.flatnonzero(joined)[order]] = np.arange(len(order), dtype=np.int32)
    return number[inverse]
