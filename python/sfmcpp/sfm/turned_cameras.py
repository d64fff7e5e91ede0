"""Cameras of unknown focal length that only turned.

Two images of such a camera are related by a homography, as those of a plane are, and a model could be made
of them whose depths mean nothing. But the homography of a rotation R is ``K R K⁻¹``: one focal length makes
all of them rotations, which none does for those of planes. A lens that bends lines hides the homographies;
there one focal length and distortion make rotations of the rays.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sfmcpp.geometry import two_view_geometry
from sfmcpp.geometry.pinhole import PINHOLE, homogeneous, inverse_calibration, to_normalised, unit
from sfmcpp.geometry.so3 import nearest_rotation
from sfmcpp.geometry.two_view_matrices import homography_errors_px
from sfmcpp.model.arrays import FloatArray, IndexArray
from sfmcpp.model.threads import on_threads, thread_count
from sfmcpp.sfm.cameras import Cameras
from sfmcpp.sfm.match_graph import MatchGraph, Pair
from sfmcpp.sfm.tracks import connected_parts
from sfmcpp.sfm.turned_lenses import lenses_of_rotations

# Focal lengths that are tried, in lengths of the longer side. Before longer lenses than these a plane that
# moves sideways looks like a rotation.
_TRIED = np.geomspace(0.3, 2.5, 30)
# Pairs that are tried, those first that have most matches.
_PAIRS = 20
# A lens of three unknowns makes a rotation of any one pair of few matches.
_FEWEST = 2
# Part of the pairs of a camera that must be rotations, and how much worse these may fit than homographies.
_MOST, _WORSE = 0.9, 1.5
# Of a sample of so many pairs, so much must be: of thousands that moved, not a tenth need be tried.
_SAMPLE, _OF_SAMPLE = 40, 0.5
# No matches are better; without noise, both errors are rounding [px].
_LEAST_ERROR_PX = 0.1


@dataclass(frozen=True)
class _Matches:
    """Positions of the matches of a homography in both images, and its median error [px]."""

    first: FloatArray
    second: FloatArray
    error_px: float


def with_turned_cameras(graph: MatchGraph, cameras: Cameras) -> MatchGraph:
    """Tell pairs of cameras of unknown focal length that only turned from those that see a plane.

    Parameters
    ----------
    graph : MatchGraph
        Images, and pairs that were verified without a focal length.
    cameras : Cameras
        Those whose focal length is guessed are looked at, unless pairs see a scene in depth.

    Returns
    -------
    MatchGraph
        Where one lens makes rotations of nearly all pairs of a camera, these are of the kind ``"rotation"``;
        else the same graph.
    """
    pairs = list(graph.pairs)
    by_camera = graph.pairs_by_camera(cameras.of_image)
    for camera in np.flatnonzero(cameras.guessed).tolist():
        numbers = [n for n in by_camera[camera] if pairs[n].geometry.kind in ("planar", "general")]
        turned = _rotations(graph, [pairs[n] for n in numbers], cameras.intrinsics[camera])
        for number, pair in zip(numbers, turned, strict=False):
            pairs[number] = pair
    return replace(graph, pairs=pairs)


def _rotations(graph: MatchGraph, pairs: Sequence[Pair], row: FloatArray) -> list[Pair]:
    """The pairs as rotations, as far as they are; nothing if too few of them are.

    Images that rotations connect are of one place: what is left of their pairs can tell no depth either.
    """
    turned = _rotations_of_pinhole(graph, pairs, row) or _rotations_of_lens(graph, pairs, row)
    place = _places(turned, len(graph.photos))
    return [_as_rotation(p) if place[p.first] == place[p.second] else p for p in turned]


def _places(turned: Sequence[Pair], images: int) -> IndexArray:
    """(I,) the same number for images that rotations connect."""
    links = [(pair.first, pair.second) for pair in turned if pair.geometry.kind == "rotation"]
    return connected_parts(np.array(links, dtype=np.intp).reshape(-1, 2), images)


def _as_rotation(pair: Pair) -> Pair:
    return replace(pair, geometry=replace(pair.geometry, kind="rotation"))


def _rotations_of_pinhole(graph: MatchGraph, pairs: Sequence[Pair], row: FloatArray) -> list[Pair]:
    least = _MOST * len(pairs)
    planar = sorted((p for p in pairs if p.geometry.kind == "planar"), key=lambda p: -p.num_verified)
    if not planar or len(planar) < least:
        return []
    focal_px = _focal_of_rotations([_matches_of(graph, pair) for pair in planar[:_PAIRS]], row)
    if focal_px is None:
        return []
    known = np.concatenate([[focal_px], row[1:]])
    return _if_rotations(graph, pairs, known, np.ones(len(pairs), dtype=np.intp))


def _rotations_of_lens(graph: MatchGraph, pairs: Sequence[Pair], row: FloatArray) -> list[Pair]:
    """Pairs as rotations of a lens that distorts; pairs of few matches, which lie in corners, count less."""
    if len(pairs) < _FEWEST:
        return []
    matches = np.array([pair.num_verified for pair in pairs])
    lenses = lenses_of_rotations(graph, pairs, row)
    found = (_if_rotations(graph, pairs, lens, matches) for lens in lenses)
    return next((turned for turned in found if turned), [])


def _if_rotations(
    graph: MatchGraph, pairs: Sequence[Pair], row: FloatArray, weights: IndexArray
) -> list[Pair]:
    """The pairs verified with these intrinsics; nothing if rotations have less than `_MOST` of the weight.

    A sample comes first, then pairs of most weight: where a camera has moved, the first few tell.
    """
    turned = list(pairs)
    most = int(weights.sum())
    least = _MOST * most
    order = np.argsort(-weights, kind="stable")
    sample = _spread_over_weight(order, weights)
    first = np.unique(sample)
    in_turn = [*first.tolist(), *order[~np.isin(order, first)].tolist()]
    for tried, (number, pair) in enumerate(_verified_with(graph, pairs, in_turn, row), start=1):
        turned[number] = pair
        most -= int(weights[number]) * (pair.geometry.kind != "rotation")
        if most < least or (tried == len(first) and _part_of_rotations(turned, sample) < _OF_SAMPLE):
            return []
    return turned


def _spread_over_weight(order: NDArray[np.integer], weights: IndexArray) -> NDArray[np.integer]:
    """(s,) numbers of pairs, spread evenly over the weight of all in an order; heavy ones several times."""
    ends = np.cumsum(weights[order])
    return np.asarray(order[np.searchsorted(ends, (np.arange(_SAMPLE) + 0.5) / _SAMPLE * ends[-1])])


def _part_of_rotations(pairs: Sequence[Pair], numbers: NDArray[np.integer]) -> float:
    return float(np.mean([pairs[number].geometry.kind == "rotation" for number in numbers]))


def _verified_with(
    graph: MatchGraph, pairs: Sequence[Pair], numbers: Sequence[int], row: FloatArray
) -> Iterator[tuple[int, Pair]]:
    """Pairs by their numbers in turn, verified with these intrinsics a few at a time."""
    threads = thread_count()
    for begin in range(0, len(numbers), threads):
        some = numbers[begin : begin + threads]
        again = on_threads(lambda number: _verified_again(graph, pairs[number], row), some, threads)
        yield from zip(some, again, strict=True)


def _matches_of(graph: MatchGraph, pair: Pair) -> _Matches:
    first = graph.features[pair.first].pixels[pair.verified[:, 0]]
    second = graph.features[pair.second].pixels[pair.verified[:, 1]]
    homography = pair.geometry.homography
    error_px = max(_LEAST_ERROR_PX, _median_error_px(homography, first, second))
    return _Matches(first, second, error_px)


def _median_error_px(homography: FloatArray, first: FloatArray, second: FloatArray) -> float:
    return float(np.median(homography_errors_px(homography, first, second)))


def _focal_of_rotations(pairs: Sequence[_Matches], row: FloatArray) -> float | None:
    """Focal length with which rotations explain nearly all pairs as well as homographies do [px]."""

    def worse(focal_px: float) -> FloatArray:
        return np.array([_rotation_error_px(m, focal_px, row) / m.error_px for m in pairs])

    focal_px = focal_of_least(lambda focal: float(np.median(worse(focal))), row)
    return focal_px if np.mean(worse(focal_px) <= _WORSE) >= _MOST else None


def focal_of_least(error: Callable[[float], float], row: FloatArray) -> float:
    """Focal length [px] with which an error is least, of those that a lens with this centre may have."""
    from scipy.optimize import minimize_scalar

    tried = _TRIED * 2 * row[2:4].max()
    best = int(np.argmin([error(focal) for focal in tried]))
    around = tried[max(best - 1, 0)], tried[min(best + 1, len(tried) - 1)]
    return float(minimize_scalar(error, bounds=around, method="bounded").x)


def _rotation_error_px(matches: _Matches, focal_px: float, row: FloatArray) -> float:
    """Median error of the rotation that fits the rays of matches best, for a focal length [px]."""
    known = np.concatenate([[focal_px], row[1:PINHOLE]])
    first, second = (unit(homogeneous(to_normalised(p, known))) for p in (matches.first, matches.second))
    inverse = inverse_calibration(known)
    turned = np.linalg.inv(inverse) @ nearest_rotation(second.T @ first) @ inverse
    return _median_error_px(turned, matches.first, matches.second)


def _verified_again(graph: MatchGraph, pair: Pair, row: FloatArray) -> Pair:
    first = graph.features[pair.first].pixels[pair.matches[:, 0]]
    second = graph.features[pair.second].pixels[pair.matches[:, 1]]
    geometry = two_view_geometry(first, second, row, row)
    return replace(pair, geometry=geometry) if geometry.kind == "rotation" else pair
