"""Folded models: pairs of images whose matches, or missing matches, contradict the model.

Windows that look alike, or the two sides of a symmetric building, match as well as one thing seen twice.
Where some of such matches are taken up in a model, others of the same kind are in its way.

Two sides of a building that look alike can fold into one, and every match agrees with the model. The missing
matches reveal it: behind the building the photos of one side show what those of the other side do not (Zach,
Irschara, Bischof, "What can missing correspondences tell us about 3D structure and motion?", CVPR 2008).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from sfmcpp.geometry.epipolar import closest_depths, dot, fundamental_matrix, sampson_errors_px
from sfmcpp.geometry.pinhole import homogeneous, pinhole_rows, to_normalised
from sfmcpp.map import Map
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.sfm.match_graph import MatchGraph, Pair
from sfmcpp.sfm.settings import IncrementalSettings

# Fewer matches agree by chance, now and then.
_MANY = 30
# A pair contradicts the model if less than this part of its matches agrees with it.
_AGREE = 0.5
_NORMALISED = np.array([1.0, 1.0, 0.0, 0.0, 0.0])
# Pairs of each image that are looked at: those with most matches, which a fold makes of what it folds.
_PARTNERS = 6
_FEWEST_MATCHES = 15
# An image tells of a neighbour what it shows if it sees it from nearly there and from as far away [deg]: from
# more to the side, something else may stand in between.
_LARGEST_ANGLE_DEG, _LARGEST_SCALE = 6.0, 4 / 3
# A point seen under less than this may be anywhere on its ray, and shows a turn of the camera only [deg].
_LEAST_ANGLE_DEG, _ANY_ANGLE_DEG = 0.5, 3.0
_FAR = 1e6
# Of what both should show, so much must be matched: with less, nothing can be told of a part of the image.
_FEWEST_POINTS, _LEAST_RATE = 50, 0.5
_BORDER = 0.03
# Nothing is matched in three by three cells of so many along the image, where so many points should be …
_CELLS, _FEWEST_IN_CELLS = 24, 6
# … and that of so many points, in both images, in so many pairs, and such a part of all that are looked at,
# and of so many points of all these pairs. Of sets that are as they should be hardly a pair has one.
_FEWEST_MISSING, _FEWEST_PAIRS, _LEAST_PART, _FEWEST_IN_ALL = 4, 2, 0.01, 16


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
        Those with most matches first; none if it is a single one of few matches among many, which somebody
        who walks through the scene can make.
    """
    inside = world.registered.tolist()
    looked_at = [
        pair
        for pair in graph.pairs
        if inside[pair.first]
        and inside[pair.second]
        and pair.geometry.kind in ("general", "planar")
        and pair.num_verified >= _MANY
    ]
    found = [
        pair
        for pair in looked_at
        if np.mean(epipolar_errors_px(graph, world, pair) <= settings.outlier_px) < _AGREE
    ]
    matches, all_matches = (sum(pair.num_verified for pair in pairs) for pairs in (found, looked_at))
    if len(found) < _FEWEST_PAIRS and matches < _LEAST_PART * all_matches:
        return []
    return sorted(found, key=lambda pair: -pair.num_verified)


def epipolar_errors_px(graph: MatchGraph, world: Map, pair: Pair) -> FloatArray:
    """Sampson errors [px] that the verified matches of a pair have by the poses of the model, (k,)."""
    sides, focal = [], 0.0
    for image, column in ((pair.first, 0), (pair.second, 1)):
        row = pinhole_rows(world.intrinsics[world.image_cameras[image]])
        sides.append(to_normalised(graph.features[image].pixels[pair.verified[:, column]], row))
        focal += row[0] / 2
    f = fundamental_matrix(world.poses[pair.first], world.poses[pair.second], _NORMALISED, _NORMALISED)
    return np.asarray(focal * sampson_errors_px(f, *sides))


def contradiction_warning(graph: MatchGraph, pairs: list[Pair]) -> str:
    """Warning about these pairs, in a sentence."""
    worst = pairs[0]
    names = f"{graph.photos[worst.first].name} and {graph.photos[worst.second].name}"
    count = "2 images" if len(pairs) == 1 else f"{len(pairs)} pairs of images"
    return (
        f"{count} match well but contradict the model, first {names} "
        f"({worst.num_verified} matches): with repeated or symmetric structure, the model may be folded, "
        "and with one focal length for photos of several, bent"
    )


@dataclass(frozen=True, eq=False)
class _ConfirmedFeatures:
    """Features of an image that matches with other images confirm: one row for each match.

    Attributes
    ----------
    features : (m,) int
        Feature of the image.
    others : (m,) int
        The image that confirms it.
    depths : (m,) float64
        Distance along the ray (x, y, 1); infinite where the rays are parallel.
    angles_deg : (m,) float64
        Between both rays.
    bases : (m,) float64
        Distance of both images.
    """

    features: NDArray[np.int32]
    others: NDArray[np.int32]
    depths: FloatArray
    angles_deg: FloatArray
    bases: FloatArray


@dataclass(frozen=True, eq=False)
class _View:
    """An image of a model.

    Attributes
    ----------
    camera : (3, 4) float64
        Its pose.
    pixels : (n, 2) float64
        Of its features.
    rays : (n, 3) float64
        Their directions in the world, of depth 1.
    row : (12,) float64
        Intrinsics.
    size : (2,) float64
        Width and height [px].
    """

    camera: FloatArray
    pixels: FloatArray
    rays: FloatArray
    row: FloatArray
    size: FloatArray


def pairs_with_missing_matches(graph: MatchGraph, world: Map, settings: IncrementalSettings) -> list[Pair]:
    """Find pairs of images of which each shows what the other, from nearly the same place, does not.

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
        Those with most matches first; none if there are too few for a suspicion, or for images that are known
        by their tracks: what a tracker has lost for a while is no sign.
    """
    if any(photo.path is None for photo in graph.photos):
        return []
    views = [_model_view(graph, world, i) if world.registered[i] else None for i in range(world.num_images)]
    inside = [
        pair
        for pair in graph.pairs
        if world.registered[[pair.first, pair.second]].all() and len(pair.matches) >= _FEWEST_MATCHES
    ]
    sights = _confirmed_features(inside, views, settings.outlier_px)
    closest = _best_matched_pairs(inside, world.num_images)
    missing = np.array([_num_missing_in_both(sights, views, pair) for pair in closest], dtype=np.intp)
    found = np.flatnonzero(missing >= _FEWEST_MISSING)
    if len(found) < max(_FEWEST_PAIRS, _LEAST_PART * len(closest)) or missing[found].sum() < _FEWEST_IN_ALL:
        return []
    return [closest[k] for k in found]


def _num_missing_in_both(
    sights: Sequence[_ConfirmedFeatures], views: Sequence[_View | None], pair: Pair
) -> int:
    one, other = views[pair.first], views[pair.second]
    if one is None or other is None:
        return 0
    missing = _num_missing_points(sights[pair.first], one, other, pair.second, pair.matches[:, 0])
    if not missing:
        return 0
    return min(missing, _num_missing_points(sights[pair.second], other, one, pair.first, pair.matches[:, 1]))


def _model_view(graph: MatchGraph, world: Map, image: int) -> _View:
    camera, row = world.poses[image], world.intrinsics[world.image_cameras[image]]
    pixels = graph.features[image].pixels
    rays = homogeneous(to_normalised(pixels, pinhole_rows(row))) @ camera[:, :3].T
    size = world.camera_sizes[world.image_cameras[image]].astype(np.float64)
    size = np.maximum(size, pixels.max(axis=0, initial=1.0))
    return _View(camera, pixels, rays, row, size)


def _best_matched_pairs(pairs: Sequence[Pair], num_images: int) -> list[Pair]:
    """Pairs with a geometry that are among those with most matches of one of their images."""
    taken = np.zeros(num_images, dtype=np.intp)
    chosen = []
    for pair in sorted(pairs, key=lambda pair: -pair.num_verified):
        ends = [pair.first, pair.second]
        if pair.geometry.kind != "none" and taken[ends].min() < _PARTNERS:
            taken[ends] += 1
            chosen.append(pair)
    return chosen


def _confirmed_features(
    pairs: Sequence[Pair], views: Sequence[_View | None], outlier_px: float
) -> list[_ConfirmedFeatures]:
    """Confirmed features of each image, by the matches that agree with the model."""
    parts: list[list[_ConfirmedFeatures]] = [[] for _ in views]
    for pair in pairs:
        one, other = views[pair.first], views[pair.second]
        if one is not None and other is not None:
            depths, angles, good = _match_depths(one, other, pair, outlier_px)
            base = float(np.linalg.norm(other.camera[:, 3] - one.camera[:, 3]))
            for k, (image, by) in enumerate(((pair.first, pair.second), (pair.second, pair.first))):
                features, bases = pair.matches[good, k], np.full(np.count_nonzero(good), base)
                others = np.full(len(features), by, dtype=np.int32)
                found = _ConfirmedFeatures(features, others, depths[k][good], angles[good], bases)
                parts[image].append(found)
    return [_concatenated_features(part) for part in parts]


def _concatenated_features(parts: list[_ConfirmedFeatures]) -> _ConfirmedFeatures:
    none, empty = np.empty(0, dtype=np.int32), np.empty(0)
    columns = [[getattr(part, field.name) for part in parts] for field in fields(_ConfirmedFeatures)]
    first = (none, none, empty, empty, empty)
    return _ConfirmedFeatures(*(np.concatenate([a, *c]) for a, c in zip(first, columns, strict=True)))


def _match_depths(
    one: _View, other: _View, pair: Pair, outlier_px: float
) -> tuple[tuple[FloatArray, FloatArray], FloatArray, BoolArray]:
    """Where the rays of a pair's matches come nearest: depths, angles, and which of them nearly meet."""
    a, b = one.rays[pair.matches[:, 0]], other.rays[pair.matches[:, 1]]
    base = other.camera[:, 3] - one.camera[:, 3]
    squares = dot(a, a) * dot(b, b)
    depth_1, depth_2, factor = closest_depths(a, b, base)
    apart = factor > 1e-10 * squares
    safe = np.where(apart, factor, 1.0)
    first, second = (np.where(apart, depth / safe, np.inf) for depth in (depth_1, depth_2))
    angles = np.degrees(np.arccos((dot(a, b) / np.sqrt(squares)).clip(-1, 1)))
    # By how much the rays miss each other, seen from the nearer camera; parallel ones do not.
    gap = np.abs(np.cross(a, b) @ base) / np.sqrt(safe)
    near = np.minimum(first, second).clip(1e-12, _FAR)
    good = (first > 0) & (second > 0) & (gap * one.row[0] <= outlier_px * near)
    return (first, second), angles, np.asarray(good | ~apart)


def _num_missing_points(
    sight: _ConfirmedFeatures, one: _View, other: _View, number: int, matched: NDArray[np.int32]
) -> int:
    """Points of `one` that `other`, image `number`, should show, where nothing of one is `matched`."""
    features, nearest, farthest, angles = _confirmed_points(sight, one, number)
    should = _in_view(one, other, nearest, angles) & _in_view(one, other, farthest, angles)
    features = features[should]
    is_matched = np.zeros(len(one.pixels), dtype=np.bool_)
    is_matched[matched] = True
    if len(features) < _FEWEST_POINTS or is_matched[features].mean() < _LEAST_RATE:
        return 0
    cells = np.floor(one.pixels[features] / one.size.max() * _CELLS).astype(np.intp)
    there = _cell_sums(cells, np.ones(len(cells)))
    empty = (_neighbourhood_sums(there) >= _FEWEST_IN_CELLS) & (
        _neighbourhood_sums(_cell_sums(cells, is_matched[features].astype(np.float64))) == 0
    )
    return int(there[empty].sum())


def _confirmed_points(
    sight: _ConfirmedFeatures, one: _View, number: int
) -> tuple[NDArray[np.intp], FloatArray, FloatArray, FloatArray]:
    """Features that images other than `number` confirm, their points, and the widest angle of each [deg].

    Points seen under too small an angle are somewhere on their ray, between the nearest and the farthest
    place: from two images that are nearly one, as of a burst, even a near point is.
    """
    rows = np.flatnonzero(sight.others != number)
    rows = rows[np.argsort(sight.angles_deg[rows], kind="stable")]
    widest = np.full(len(one.pixels), -1, dtype=np.intp)
    widest[sight.features[rows]] = rows
    features = np.flatnonzero(widest >= 0)
    rows = widest[features]
    angles, is_open = sight.angles_deg[rows], sight.angles_deg[rows] <= _LEAST_ANGLE_DEG
    farthest = np.where(is_open, np.inf, sight.depths[rows])
    # The scale of a model is its own: far is far against the depths that there are.
    usual = np.median(farthest[~is_open]) if not is_open.all() else 1.0
    farthest = np.minimum(farthest, _FAR * usual)
    nearest = np.where(is_open, sight.bases[rows] / np.radians(_LEAST_ANGLE_DEG), farthest)
    nearest, farthest = (
        one.camera[:, 3] + depths[:, None] * one.rays[features]
        for depths in (np.minimum(nearest, farthest), farthest)
    )
    return features, nearest, farthest, angles


def _in_view(one: _View, other: _View, points: FloatArray, angles_deg: FloatArray) -> BoolArray:
    """Which points (n, 3) of one the other must see much as one does; others see them from farther off."""
    in_camera = (points - other.camera[:, 3]) @ other.camera[:, :3]
    in_front = in_camera[:, 2] > 0
    flat = in_camera[:, :2] / np.where(in_front, in_camera[:, 2], 1.0)[:, None]
    pixels = flat * other.row[0] + other.row[2:4]
    border = _BORDER * other.size.max()
    inside = ((pixels > border) & (pixels < other.size - border)).all(axis=1)
    here, there = points - one.camera[:, 3], points - other.camera[:, 3]
    far, far_there = np.linalg.norm(here, axis=1), np.linalg.norm(there, axis=1)
    between = np.degrees(np.arccos(((here * there).sum(axis=1) / (far * far_there)).clip(-1, 1)))
    scale = np.maximum(far / far_there, far_there / far)
    alike = (between < _LARGEST_ANGLE_DEG) & (between <= np.maximum(angles_deg, _ANY_ANGLE_DEG))
    return np.asarray(in_front & inside & alike & (scale < _LARGEST_SCALE))


def _cell_sums(cells: NDArray[np.intp], weights: FloatArray) -> FloatArray:
    """Sums of weights in each cell of an image, a row and a column of empty ones around."""
    total = np.zeros((_CELLS + 3, _CELLS + 3))
    np.add.at(total, (cells[:, 1].clip(0, _CELLS) + 1, cells[:, 0].clip(0, _CELLS) + 1), weights)
    return total


def _neighbourhood_sums(total: FloatArray) -> FloatArray:
    """Sums over three by three cells."""
    rows = total + np.roll(total, 1, axis=0) + np.roll(total, -1, axis=0)
    return np.asarray(rows + np.roll(rows, 1, axis=1) + np.roll(rows, -1, axis=1))


def missing_matches_warning(graph: MatchGraph, pairs: list[Pair]) -> str:
    """Warning about these pairs, in a sentence."""
    first, second = graph.photos[pairs[0].first].name, graph.photos[pairs[0].second].name
    return (
        f"{len(pairs)} pairs of images are at the same position in the model but do not show the same scene, "
        f"first {first} and {second}: with repeated or symmetric structure, the model may be folded"
    )
