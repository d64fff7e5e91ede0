"""Smaller copies of photos: the same view at another size, which shows no parallax.

Of a photo and its copy, errors of the keypoints are all the parallax there is: points that only both see
come to lie anywhere on their rays, as the copy has a camera, and so a distortion, of its own.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sfmcpp.model.arrays import IndexArray
from sfmcpp.sfm.match_graph import MatchGraph, Pair

# At the same place, in parts of the image, to within a pixel of the smaller one, are nearly all matches of a
# copy, and hardly any of two photos.
_NEAR_PX, _MOST, _FEWEST_MATCHES = 1.0, 0.9, 50


def without_resized_copies(graph: MatchGraph) -> tuple[MatchGraph, dict[str, str]]:
    """Leave out the photos that are smaller copies of others.

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
    sizes = [np.array(graph.photos[image].size) for image in (pair.first, pair.second)]
    if len(pair.matches) < _FEWEST_MATCHES or (sizes[0] == sizes[1]).all():
        return False
    first, second = (
        _places(graph, image, matched, size)
        for image, matched, size in zip((pair.first, pair.second), pair.matches.T, sizes, strict=True)
    )
    apart_px = np.linalg.norm((first - second) * np.minimum(*sizes), axis=1)
    return bool(np.mean(apart_px <= _NEAR_PX) >= _MOST)


def _places(graph: MatchGraph, image: int, matched: IndexArray, size: IndexArray) -> np.ndarray:
    """(m, 2) where features are, in parts of the image."""
    return np.asarray(graph.features[image].pixels[matched] / size)
