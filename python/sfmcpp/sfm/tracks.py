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
    return Tracks(begin, track, int(track.max(initial=NO_TRACK)) + 1, apart[differ])


def _match_links(graph: MatchGraph, begin: Links) -> tuple[Links, NDArray[np.intp]]:
    """(e, 2) keypoints of all verified matches, and the inliers of their pairs (e,)."""
    pairs = [pair for pair in graph.pairs if pair.geometry.kind != "none"]
    links = [pair.verified + begin[[pair.first, pair.second]] for pair in pairs]
    strength = [np.full(len(some), len(some), dtype=np.intp) for some in links]
    empty = np.empty(0, dtype=np.intp)
    return np.concatenate([np.empty((0, 2), dtype=np.intp), *links]), np.concatenate([empty, *strength])


def connected_parts(links: Links, count: int) -> NDArray[np.int32]:
    """The same number for those of `count` things that links (e, 2) connect, (count,)."""
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


def _join_without_conflict(links: Links, strength: Links, image: Links) -> tuple[Links, Links]:
    """Links that join, and those set apart; the strongest come first."""
    root: dict[int, int] = {}
    sees: dict[int, set[int]] = {}

    def find(keypoint: int) -> int:
        while (above := root.setdefault(keypoint, keypoint)) != keypoint:
            root[keypoint] = root.setdefault(above, above)
            keypoint = root[keypoint]
        return keypoint

    joins = np.zeros(len(links), dtype=np.bool_)
    for place in np.argsort(-strength, kind="stable").tolist():
        first, second = (find(int(keypoint)) for keypoint in links[place])
        a, b = (sees.setdefault(top, {int(image[top])}) for top in (first, second))
        joins[place] = first == second or a.isdisjoint(b)
        if joins[place] and first != second:
            big, small = (first, second) if len(a) >= len(b) else (second, first)
            root[small] = big
            sees[big] |= sees.pop(small)
    return links[joins], links[~joins]


def _numbered_components(parts: NDArray[np.int32]) -> IndexArray:
    """Number the components of two keypoints and more in the order of their first keypoints."""
    _, first, inverse, counts = np.unique(parts, return_index=True, return_inverse=True, return_counts=True)
    joined = counts > 1
    order = np.argsort(first[joined], kind="stable")
    number = np.full(len(first), NO_TRACK, dtype=np.int32)
    number[np.flatnonzero(joined)[order]] = np.arange(len(order), dtype=np.int32)
    return number[inverse]
