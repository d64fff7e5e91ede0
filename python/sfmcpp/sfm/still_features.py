"""What stands still in the images while the scene moves: a frame, a time stamp, what is behind a turntable.

Its matches agree with each other, as those of a camera that did not move, and in many pairs they are more
than those of the scene. Where the camera itself did not move, what passes before it is left out instead.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model.arrays import BoolArray, FloatArray, largest_of_each
from sfmcpp.model.threads import Progress, no_progress, results_in_order, thread_count
from sfmcpp.sfm.front_end import FrontEndSettings, Intrinsics, estimated_geometry
from sfmcpp.sfm.match_graph import MatchGraph, Pair
from sfmcpp.sfm.tracks import connected_parts

# A match stands still that moves by no more, and a feature whose matches stay that near in all images [px].
_STILL_PX = 1.0
# Where something stands still, matches that move by no more are of it, too: not all of its features are found
# in most images, and those of coarse scales are less accurate [px].
_NEARLY_STILL_PX = 2.0
# So many images and more than this part of those of one size must show it: a burst, or exposures from one
# tripod, are fewer.
_FEWEST_IMAGES, _MOST_OF_IMAGES = 4, 0.5
# Of what is left out of pairs that hold without it, so much must stand still there: of what several tripods
# see, features move from one to the next.
_LEAST_STILL = 0.5
# The camera stood where something stands still, now or then, in more than this part of the image, and at so
# many of the places where something moves. Cells along each side of an image in which that is counted.
_MOST_OF_IMAGE, _MOST_OF_MOVING, _CELLS = 0.5, 0.75, 24


def without_still_features(
    graph: MatchGraph, intrinsics: Intrinsics, settings: FrontEndSettings, progress: Progress = no_progress
) -> tuple[MatchGraph, list[str]]:
    """Leave out the matches of what stands still in most images, if the rest of most images moves.

    Where the camera stood, and others passed before it, the matches of these are left out.

    Parameters
    ----------
    graph : MatchGraph
        Of photos; left as it is.
    intrinsics : sequence of (12,) float64 or None
        Of each photo's camera; None where they are unknown.
    settings : FrontEndSettings
        Those the graph was made with.
    progress : callable
        Called with the stage ``"geometry"`` while pairs are verified anew.

    Returns
    -------
    MatchGraph
        The same where nothing stands still, or nothing else agrees.
    list of str
        A warning at most.
    """
    still = still_features(graph)
    if not any(some.any() for some in still):
        return graph, []
    dropped = {k: out for k, pair in enumerate(graph.pairs) if (out := _is_dropped(graph, pair, still)).any()}

    def verified_anew(number: int) -> Pair:
        pair = graph.pairs[number]
        i, j, matches = pair.first, pair.second, pair.matches[~dropped[number]]
        one, other = graph.features[i], graph.features[j]
        geometry = estimated_geometry(one, other, intrinsics[i], intrinsics[j], matches, settings)
        return replace(pair, matches=matches, geometry=geometry)

    threads = thread_count(settings.threads)
    anew = results_in_order(verified_anew, list(dropped), threads, stage="geometry", progress=progress)
    pairs = list(graph.pairs)
    for number, pair in zip(dropped, anew, strict=True):
        pairs[number] = pair
    standing = _standing_pairs(graph, still, settings)
    if _camera_stood(graph, [pairs[number] for number in standing], standing.values()):
        pairs = [standing.get(number, pair) for number, pair in enumerate(graph.pairs)]
        return replace(graph, pairs=pairs), _warning_of_tripod(still)
    if not (_moves_together(graph, pairs) and _stands_where_others_move(graph, pairs, dropped)):
        return graph, []
    return replace(graph, pairs=pairs), [_warning(still)]


def still_features(graph: MatchGraph) -> list[BoolArray]:
    """Which features of each image are matched in the same place of most images of its size."""
    counts = np.array([len(features) for features in graph.features], dtype=np.intp)
    begin = np.concatenate([[0], np.cumsum(counts)])
    links = [
        pair.matches[_stands(graph, pair, _STILL_PX)] + begin[[pair.first, pair.second]]
        for pair in graph.pairs
    ]
    keypoints, ends = np.unique(np.concatenate([np.empty((0, 2), np.intp), *links]), return_inverse=True)
    chosen = np.zeros(int(begin[-1]), dtype=np.bool_)
    if len(keypoints):
        image = np.searchsorted(begin, keypoints, side="right") - 1
        parts = connected_parts(ends.reshape(-1, 2), len(keypoints))
        pixels = np.concatenate([features.pixels for features in graph.features])[keypoints]
        in_most = _images_of(parts, image) > _enough_images(graph)[image]
        chosen[keypoints] = in_most & _is_small(parts, pixels)
    return [np.asarray(some) for some in np.split(chosen, begin[1:-1])]


def _stands(graph: MatchGraph, pair: Pair, most_px: float) -> BoolArray:
    """Which matches of a pair are in the same place of both images; none of images of different sizes."""
    if graph.photos[pair.first].size != graph.photos[pair.second].size:
        return np.zeros(len(pair.matches), dtype=np.bool_)
    first, second = (
        graph.features[image].pixels[matched]
        for image, matched in zip((pair.first, pair.second), pair.matches.T, strict=True)
    )
    return np.asarray(np.linalg.norm(second - first, axis=1) <= most_px)


def stands_still(graph: MatchGraph, pair: Pair) -> bool:
    """Whether all that agrees in a pair is in the same place of both images."""
    return bool(_stands(graph, pair, _NEARLY_STILL_PX)[pair.geometry.inliers].all())


def _enough_images(graph: MatchGraph) -> FloatArray:
    """(I,) number of images that must be exceeded, for those of the size of each image."""
    sizes = Counter(photo.size for photo in graph.photos)
    counts = np.array([sizes[photo.size] for photo in graph.photos])
    return np.asarray(np.maximum(_MOST_OF_IMAGES * counts, _FEWEST_IMAGES - 1))


def _images_of(parts: NDArray[np.int32], image: NDArray[np.intp]) -> NDArray[np.intp]:
    """Number of images that the part of each keypoint is in."""
    both = np.unique(np.column_stack([parts, image]), axis=0)
    return np.bincount(both[:, 0])[parts]


def _is_small(parts: NDArray[np.int32], pixels: FloatArray) -> BoolArray:
    """Whether the part of each keypoint stays in its place: what moves slowly drifts away."""
    high, minus_low = (largest_of_each(parts, x, len(parts), least=-np.inf) for x in (pixels, -pixels))
    return np.asarray((high + minus_low).max(axis=1)[parts] <= 2 * _STILL_PX)


def _of_still(pair: Pair, still: Sequence[BoolArray]) -> BoolArray:
    """Which matches of a pair are of a still feature."""
    return np.asarray(still[pair.first][pair.matches[:, 0]] | still[pair.second][pair.matches[:, 1]])


def _is_dropped(graph: MatchGraph, pair: Pair, still: Sequence[BoolArray]) -> BoolArray:
    return _of_still(pair, still) | _stands(graph, pair, _NEARLY_STILL_PX)


def _standing_pairs(
    graph: MatchGraph, still: Sequence[BoolArray], settings: FrontEndSettings
) -> dict[int, Pair]:
    """Pairs by number in which most of the still features stand, with only the matches that stand."""
    found, shows = {}, [bool(some.any()) for some in still]
    for number, pair in enumerate(graph.pairs):
        if not (shows[pair.first] and shows[pair.second]):
            continue
        known, stands = _of_still(pair, still), _stands(graph, pair, _STILL_PX)
        if np.count_nonzero(known & stands) >= _LEAST_STILL * np.count_nonzero(known):
            found[number] = _as_unmoved(graph, replace(pair, matches=pair.matches[stands]), settings)
    return found


def _as_unmoved(graph: MatchGraph, pair: Pair, settings: FrontEndSettings) -> Pair:
    """The pair with the geometry of an image and itself: noise must not make a plane of it."""
    image, itself = graph.features[pair.first], pair.matches[:, [0, 0]]
    return replace(pair, geometry=estimated_geometry(image, image, None, None, itself, settings))


def _camera_stood(graph: MatchGraph, moved: Iterable[Pair], standing: Iterable[Pair]) -> bool:
    """Whether what stands still covers most of the images, and what moves passes before it.

    Beside a frame or on a turntable, what moves is where nothing ever stands still; under a watermark, it
    covers more of the images than what does.
    """
    moving = _verified_features(graph, _that_moved(moved))
    stands, moves = (_cells_with(graph, some) for some in (_verified_features(graph, standing), moving))
    shows = stands.any(axis=1)
    if not shows.any():
        return False
    seen = _cells_with(graph, [np.ones_like(some) for some in moving])[shows]
    background = stands.sum(axis=0) >= _FEWEST_IMAGES
    least = max(_MOST_OF_IMAGE * seen.sum(axis=1).mean(), moves[shows].sum(axis=1).mean())
    before = np.concatenate([background[_cells_of(graph, image)[some]] for image, some in enumerate(moving)])
    return bool(np.count_nonzero(background) > least and before.sum() >= _MOST_OF_MOVING * len(before))


def _verified_features(graph: MatchGraph, pairs: Iterable[Pair]) -> list[BoolArray]:
    """Which features of each image the verified matches of some pairs are of."""
    verified = [np.zeros(len(features), dtype=np.bool_) for features in graph.features]
    for pair in pairs:
        verified[pair.first][pair.verified[:, 0]] = True
        verified[pair.second][pair.verified[:, 1]] = True
    return verified


def _cells_with(graph: MatchGraph, chosen: Sequence[BoolArray]) -> BoolArray:
    """(I, cells) which cells of each image hold chosen features."""
    holds = np.zeros((len(chosen), _CELLS**2), dtype=np.bool_)
    for image, some in enumerate(chosen):
        holds[image, _cells_of(graph, image)[some]] = True
    return holds


def _cells_of(graph: MatchGraph, image: int) -> NDArray[np.intp]:
    """(n,) cell of each feature of an image."""
    parts = graph.features[image].pixels / graph.photos[image].size
    column, row = np.clip(parts * _CELLS, 0, _CELLS - 1).astype(np.intp).T
    return np.asarray(row * _CELLS + column)


def _that_moved(pairs: Iterable[Pair]) -> list[Pair]:
    return [pair for pair in pairs if pair.geometry.kind in ("general", "planar")]


def _moves_together(graph: MatchGraph, pairs: Sequence[Pair]) -> bool:
    """Whether pairs that moved connect most images: of people before a still camera they do not."""
    moved = [(pair.first, pair.second) for pair in _that_moved(pairs)]
    parts = connected_parts(np.array(moved, dtype=np.intp).reshape(-1, 2), len(graph.photos))
    return bool(np.bincount(parts).max() > _MOST_OF_IMAGES * len(graph.photos))


def _stands_where_others_move(
    graph: MatchGraph, pairs: Sequence[Pair], dropped: Mapping[int, BoolArray]
) -> bool:
    """Whether what is left out stands still in pairs whose other matches agree."""
    agreeing = [k for k in dropped if pairs[k].geometry.kind != "none"]
    stands = [dropped[k] & _stands(graph, graph.pairs[k], _NEARLY_STILL_PX) for k in agreeing]
    total = sum(np.count_nonzero(dropped[k]) for k in agreeing)
    return sum(map(np.count_nonzero, stands)) > _LEAST_STILL * total


def _warning_of_tripod(still: Sequence[BoolArray]) -> list[str]:
    """Nothing if it stood in all of the images: that there is no model is told, and why."""
    images = sum(bool(some.any()) for some in still)
    if images == len(still):
        return []
    return [
        f"the camera did not move between {images} of {len(still)} images: what moves in them is left out, "
        "and they tell no depth among themselves; move the camera between photos"
    ]


def _warning(still: Sequence[BoolArray]) -> str:
    images = sum(bool(some.any()) for some in still)
    features = sum(int(np.count_nonzero(some)) for some in still) / images
    return (
        f"{features:.0f} features each of {images} images stand still while the rest moves, and are left "
        "out: a time stamp, a border, or what is behind an object that was turned; if the camera stood still "
        "and others moved, the model is wrong: move the camera between photos"
    )
