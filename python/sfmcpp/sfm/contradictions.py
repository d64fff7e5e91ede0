"""Pairs of images that match well, and yet the model says otherwise: repeated or symmetric structure.

Windows that look alike, or the two sides of a symmetric building, match as well as one thing seen twice.
Where some of such matches are taken up in a model, others of the same kind are in its way.
"""

from __future__ import annotations

import numpy as np

from sfmcpp.geometry.epipolar import fundamental_matrix, sampson_errors_px
from sfmcpp.geometry.pinhole import pinhole_rows, to_normalised
from sfmcpp.map import Map
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sfm.match_graph import MatchGraph, Pair
from sfmcpp.sfm.settings import IncrementalSettings

# Fewer matches agree by chance, now and then.
_MANY = 30
# A pair contradicts the model if less than this part of its matches agrees with it.
_AGREE = 0.5
_NORMALISED = np.array([1.0, 1.0, 0.0, 0.0, 0.0])


def contradicting_pairs(graph: MatchGraph, world: Map, settings: IncrementalSettings) -> list[Pair]:
    """Find the pairs of images of a model whose matches agree with each other but not with the model.

    Parameters
    ----------
    graph : MatchGraph
        Images, features and pairs.
    world : Map
        The model; its images are numbered as the graph's.
    settings : IncrementalSettings
        What an outlier is.

    Returns
    -------
    list of Pair
        Those with most matches first.
    """
    found = [
        pair
        for pair in graph.pairs
        if pair.geometry.kind in ("general", "planar")
        and np.count_nonzero(pair.geometry.inliers) >= _MANY
        and world.registered[[pair.first, pair.second]].all()
        and np.mean(_errors_px(graph, world, pair) <= settings.outlier_px) < _AGREE
    ]
    return sorted(found, key=lambda pair: -len(pair.verified))


def _errors_px(graph: MatchGraph, world: Map, pair: Pair) -> FloatArray:
    """Sampson errors [px] that the matches of a pair have by the poses of the model."""
    sides, focal = [], 0.0
    for image, column in ((pair.first, 0), (pair.second, 1)):
        row = pinhole_rows(world.intrinsics[world.image_cameras[image]])
        sides.append(to_normalised(graph.features[image].pixels[pair.verified[:, column]], row))
        focal += row[0] / 2
    f = fundamental_matrix(world.poses[pair.first], world.poses[pair.second], _NORMALISED, _NORMALISED)
    return np.asarray(focal * sampson_errors_px(f, *sides))


def warning_of(graph: MatchGraph, pairs: list[Pair]) -> str:
    """Say it in a sentence."""
    worst = pairs[0]
    names = f"{graph.photos[worst.first].name} and {graph.photos[worst.second].name}"
    return (
        f"{len(pairs)} pairs of images match well but contradict the model, first {names} "
        f"({len(worst.verified)} matches): with repeated or symmetric structure, the model may be folded"
    )
