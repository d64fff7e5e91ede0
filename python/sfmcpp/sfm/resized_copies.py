"""Copies of photos at another size: smaller ones, and those without distortion. They show no parallax.

Of a photo and its copy, errors of the keypoints are all the parallax there is: points that only both see
come to lie anywhere on their rays, as the copy has a camera, and so a distortion, of its own.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import PurePosixPath

import numpy as np

from sfmcpp.model.arrays import FloatArray, IndexArray
from sfmcpp.sfm.match_graph import MatchGraph, Pair

# At the same place, in parts of the image, to within a pixel of the smaller one, are nearly all matches of a
# copy, and hardly any of two photos.
_NEAR_PX, _MOST, _FEWEST_MATCHES = 1.0, 0.9, 50
# Of the lens: powers of the squared radius. Its middle is that of the image to within a part of its size.
_POWERS, _OFF_MIDDLE = (0, 1, 2, 3), 0.05
_ROUNDS, _OUTLYING = 3, 3.0


def without_resized_copies(graph: MatchGraph) -> tuple[MatchGraph, dict[str, str]]:
    """Leave out the photos that are smaller copies of others, or copies without distortion.

    The latter have the names of the photos in another folder, as programs for dense reconstruction write
    them; the shorter path stays.

    Parameters
    ----------
    graph : MatchGraph
        Left as it is. Photos of the same size are no copies here: one camera took them, which stood still.

    Returns
    -------
    MatchGraph
        Without the copies; images are numbered anew.
    dict of str to str
        Name of the photo that each copy is of, by the name of the copy.
    """
    copies: dict[int, int] = {}
    for pair in graph.pairs:
        if _is_resized(graph, pair):
            areas = [np.prod(graph.photos[image].size) for image in (pair.first, pair.second)]
            small, large = (pair.first, pair.second) if areas[0] < areas[1] else (pair.second, pair.first)
            copies.setdefault(small, large)
        elif _is_undistorted(graph, pair):
            longer, shorter = sorted((pair.first, pair.second), key=lambda i: -len(graph.photos[i].name))
            copies.setdefault(longer, shorter)
    if not copies:
        return graph, {}
    kept = [image for image in range(len(graph.photos)) if image not in copies]
    number = {image: k for k, image in enumerate(kept)}
    pairs = [
        replace(pair, first=number[pair.first], second=number[pair.second])
        for pair in graph.pairs
        if pair.first in number and pair.second in number
    ]
    photos = [graph.photos[image] for image in kept]
    smaller = replace(graph, photos=photos, features=[graph.features[image] for image in kept], pairs=pairs)
    return smaller, {graph.photos[a].name: graph.photos[b].name for a, b in sorted(copies.items())}


def _is_resized(graph: MatchGraph, pair: Pair) -> bool:
    """Whether the matches of a pair are at the same place of images of different sizes."""
    if not _may_be_copies(graph, pair):
        return False
    first, second, size = _places(graph, pair)
    return _are_near((first - second) * size)


def _is_undistorted(graph: MatchGraph, pair: Pair) -> bool:
    """Whether a lens is all that is between images of one name in two folders."""
    names = [PurePosixPath(graph.photos[image].name) for image in (pair.first, pair.second)]
    if names[0].stem != names[1].stem or names[0].parent == names[1].parent:
        return False
    if not _may_be_copies(graph, pair):
        return False
    first, second, size = _places(graph, pair)
    errors, shift = _errors_of_lens((first - 0.5) * size, (second - 0.5) * size)
    return _are_near(errors) and bool((np.abs(shift) <= _OFF_MIDDLE * size).all())


def _errors_of_lens(first: FloatArray, second: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(m, 2) what radial functions of places in one image leave of those in the other, and (2,) the shift."""
    squared_radius = (first**2).sum(axis=1) / (first**2).sum(axis=1).max()
    radial = np.column_stack([squared_radius**power for power in _POWERS])
    errors, shift = np.zeros_like(second), np.zeros(2)
    used = np.ones(len(second), dtype=np.bool_)
    for _ in range(_ROUNDS):
        for axis in range(2):
            terms = np.column_stack([np.ones(len(first)), first[:, axis, None] * radial])
            found = np.linalg.lstsq(terms[used], second[used, axis], rcond=None)[0]
            errors[:, axis], shift[axis] = second[:, axis] - terms @ found, found[0]
        apart = np.linalg.norm(errors, axis=1)
        used = apart <= max(_NEAR_PX, _OUTLYING * float(np.median(apart)))
    return errors, shift


def _may_be_copies(graph: MatchGraph, pair: Pair) -> bool:
    one_size = graph.photos[pair.first].size == graph.photos[pair.second].size
    return len(pair.matches) >= _FEWEST_MATCHES and not one_size


def _are_near(apart_px: FloatArray) -> bool:
    return bool(np.mean(np.linalg.norm(apart_px, axis=1) <= _NEAR_PX) >= _MOST)


def _places(graph: MatchGraph, pair: Pair) -> tuple[FloatArray, FloatArray, IndexArray]:
    """(m, 2) where matches are in parts of each image, and (2,) the size of the smaller one [px]."""
    sizes = [np.array(graph.photos[image].size) for image in (pair.first, pair.second)]
    first, second = (
        graph.features[image].pixels[matched] / size
        for image, matched, size in zip((pair.first, pair.second), pair.matches.T, sizes, strict=True)
    )
    return first, second, np.minimum(*sizes)
