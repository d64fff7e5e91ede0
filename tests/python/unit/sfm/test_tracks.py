"""Tracks: union–find of matches with one keypoint of an image at most."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from sfmcpp.geometry import TwoViewGeometry
from sfmcpp.model.photos import Features, Photo
from sfmcpp.sfm import MatchGraph, Pair
from sfmcpp.sfm.tracks import NO_TRACK, TrackMembers, build_tracks

UNKNOWN = np.full((3, 3), np.nan)


def graph_of(counts: list[int], pairs: dict[tuple[int, int], list[tuple[int, int]]]) -> MatchGraph:
    photos = [Photo(str(number)) for number in range(len(counts))]
    features = []
    for count in counts:
        pixels, unknown = np.zeros((count, 2)), np.full(count, np.nan)
        none = np.zeros((count, 0), dtype=np.uint8)
        features.append(Features(pixels, unknown, unknown, np.zeros((count, 3), dtype=np.uint8), none))
    found = []
    for (i, j), matches in pairs.items():
        inliers = np.ones(len(matches), dtype=np.bool_)
        camera = np.full((3, 4), np.nan)
        geometry = TwoViewGeometry("general", inliers, UNKNOWN, UNKNOWN, camera, np.nan, "")
        found.append(Pair(i, j, np.array(matches, dtype=np.int32).reshape(-1, 2), geometry))
    return MatchGraph(photos, features, found)


def test_chains_of_matches_are_one_track() -> None:
    tracks = build_tracks(graph_of([2, 2, 2], {(0, 1): [(0, 1)], (1, 2): [(1, 0)]}))
    assert tracks.track.tolist() == [0, NO_TRACK, NO_TRACK, 0, 0, NO_TRACK]
    assert tracks.count == 1
    assert len(tracks.apart) == 0


def test_an_image_sees_a_track_once_and_the_strongest_pair_decides() -> None:
    # 0:0 – 1:0 – 2:0 – 0:1 would let image 0 see one point twice; the pair (1, 2) is the strongest.
    strong = [(0, 0), (1, 1), (2, 2)]
    graph = graph_of([2, 3, 3], {(0, 1): [(0, 0)], (1, 2): strong, (0, 2): [(1, 0), (0, 2)]})
    tracks = build_tracks(graph)
    image = np.repeat(np.arange(3), np.diff(tracks.begin))
    for track in range(tracks.count):
        seen = image[tracks.track == track]
        assert len(np.unique(seen)) == len(seen)
    assert tracks.track[tracks.begin[1]] == tracks.track[tracks.begin[2]] != NO_TRACK
    assert len(tracks.apart) >= 1
    assert (tracks.track[tracks.apart[:, 0]] != tracks.track[tracks.apart[:, 1]]).all()


def test_tracks_agree_with_a_search_through_the_matches() -> None:
    random = np.random.default_rng(3)
    counts = [30] * 6
    pairs = {}
    for i in range(6):
        for j in range(i + 1, 6):
            same = random.random(30) < 0.3
            pairs[i, j] = [(int(k), int(k)) for k in np.flatnonzero(same)]
    tracks = build_tracks(graph_of(counts, pairs))
    for point in range(30):
        left, parts = set(range(6)), []
        while left:
            part, fresh = set(), {left.pop()}
            while fresh:
                part |= fresh
                fresh = {
                    b for a in fresh for b in left - part if (point, point) in pairs[min(a, b), max(a, b)]
                }
            left -= part
            parts.append(part)
        for part in parts:
            numbers = {int(tracks.track[tracks.begin[image] + point]) for image in part}
            assert len(numbers) == 1
            assert (numbers == {NO_TRACK}) == (len(part) == 1)


def test_long_tracks_of_strong_pairs_take_in_what_fits_them() -> None:
    """Against a union of sets, one match after the other."""
    random = np.random.default_rng(5)
    pairs = {}
    for i, j in combinations(range(8), 2):
        wrong = random.integers(0, 12, (3, 2))
        same = np.repeat(np.flatnonzero(random.random(12) < 0.7)[:, None], 2, axis=1)
        matches = np.concatenate([same, wrong])
        first = np.unique(matches[:, 0], return_index=True)[1]
        pairs[i, j] = [(int(a), int(b)) for a, b in matches[np.sort(first)]]
    tracks = build_tracks(graph_of([12] * 8, pairs))
    sets = {k: {k} for k in range(96)}
    for i, j in sorted(pairs, key=lambda pair: -len(pairs[pair])):
        for a, b in pairs[i, j]:
            one, other = sets[12 * i + a], sets[12 * j + b]
            if one is not other and {k // 12 for k in one}.isdisjoint(k // 12 for k in other):
                sets.update(dict.fromkeys(one | other, one | other))
    for k in range(96):
        members = set(np.flatnonzero(tracks.track == tracks.track[k]).tolist())
        assert sets[k] == ({k} if tracks.track[k] == NO_TRACK else members)


def test_nothing_matched_gives_no_tracks() -> None:
    tracks = build_tracks(graph_of([3, 0], {}))
    assert tracks.count == 0
    assert (tracks.track == NO_TRACK).all()


def test_members_of_tracks_are_their_keypoints_in_order() -> None:
    track = np.array([2, NO_TRACK, 0, 2, NO_TRACK, 0, 2], dtype=np.int32)
    members = TrackMembers(track, 4)
    assert members.of(np.array([2, 0])).tolist() == [0, 2, 3, 5, 6]
    assert members.of(np.array([1, 3])).tolist() == members.of(np.empty(0, dtype=np.intp)).tolist() == []
