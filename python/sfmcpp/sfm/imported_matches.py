"""Match graphs from keypoints and matches of other programs: as arrays, or from a COLMAP database."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from operator import index
from os import PathLike

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.geometry import TwoViewGeometry
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import ANY, FloatArray, finite_array, shaped_array
from sfmcpp.model.photos import Features, Photo
from sfmcpp.model.threads import Progress, no_progress, results_in_order, thread_count
from sfmcpp.sfm.keypoint_checks import warnings_about_keypoints
from sfmcpp.sfm.match_graph import ImagePair, Matches, MatchGraph, Pair, geometry_of_matches, unique_matches
from sfmcpp.sources.io.checks import fault_of_image_name
from sfmcpp.sources.io.colmap.database import read_database


@checked()
def match_graph_of_arrays(
    keypoints: Sequence[ArrayLike],
    matches: Mapping[ImagePair, ArrayLike],
    sizes: ArrayLike | None = None,
    names: Sequence[str] | None = None,
    scales: Sequence[ArrayLike] | None = None,
    colors: Sequence[ArrayLike] | None = None,
    intrinsics: Sequence[ArrayLike | None] | None = None,
    *,
    threshold_px: float = 2.0,
    min_inliers: int = 15,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress = no_progress,
) -> MatchGraph:
    """Make a match graph of arrays; only its two-view geometry is computed.

    Parameters
    ----------
    keypoints : sequence of (n, 2) array
        Of each image [px]; the centre of the top left pixel is at (0.5, 0.5).
    matches : dict of (m, 2) array of int
        For a pair (i, j) of numbers of images, features of i and of j that look alike; each feature at most
        once in a pair, each pair in one order only.
    sizes : (I, 2) array of int, optional
        Width and height of each image [px]. Default: all as large as the farthest keypoint of all asks for.
    names : sequence of str, optional
        Of the images, all different, and such that models can hold them: not empty, without line breaks or
        white space at their ends. Default: their numbers, four digits at least.
    scales : sequence of (n,) array, optional
        Size of each keypoint (standard deviation of a blob) [px]; not a number where unknown, which is the
        default.
    colors : sequence of (n, 3) array, optional
        Red, green and blue of each keypoint, from 0 to 255. Default: black.
    intrinsics : sequence of (12,) float64 or None, optional
        Of each image's camera, in the order of the perspective model; None where they are unknown.
    threshold_px : float
        Largest error of a match that agrees with the geometry [px].
    min_inliers : int
        Fewest matches that must agree.
    seed : int
        Of every random sample; same seed, same result.
    threads : int, optional
        Threads at most; the result does not depend on it. Default: as many as the process may use.
    progress : callable
        Called as ``progress("geometry", done, total)``; returning True asks to stop.

    Returns
    -------
    MatchGraph
        Pairs in the order of their numbers; `warnings` doubt keypoints that do not fit the sizes.

    Raises
    ------
    InvalidArgument
        If arrays do not go together; the message names the image or the pair.
    KeyboardInterrupt
        If `progress` asked to stop.
    """
    features = [
        _features(i, *columns) for i, columns in enumerate(_columns_by_image(keypoints, scales, colors))
    ]
    photos = _photos(features, sizes, names)
    rows = _one_per_image("intrinsics", intrinsics, len(features))
    entries = [_checked_pair(pair, found, features) for pair, found in matches.items()]
    checked = dict(sorted(entries, key=lambda entry: entry[0]))
    if len(checked) < len(matches):
        twice = next((i, j) for i, j in matches if i < j and (j, i) in matches)
        raise InvalidArgument(f"matches: has both {twice} and {twice[::-1]}, must have one of them")

    def geometry_of(pair: ImagePair) -> TwoViewGeometry:
        (i, j), found = pair, checked[pair]
        limits = threshold_px, min_inliers, seed
        return geometry_of_matches(features[i], features[j], rows[i], rows[j], found, *limits)

    count = thread_count(threads)
    geometries = results_in_order(geometry_of, list(checked), count, stage="geometry", progress=progress)
    pairs = [Pair(*ij, m, g) for (ij, m), g in zip(checked.items(), geometries, strict=True)]
    warnings = [] if sizes is None else warnings_about_keypoints(features, photos)
    return MatchGraph(photos, features, pairs, warnings=warnings)


def _columns_by_image(
    keypoints: Sequence[ArrayLike],
    scales: Sequence[ArrayLike] | None,
    colors: Sequence[ArrayLike] | None,
) -> list[tuple[ArrayLike, ArrayLike | None, ArrayLike | None]]:
    count = len(keypoints)
    if count == 0:
        raise InvalidArgument("keypoints: is empty, must have an array for each image")
    others = (_one_per_image(name, given, count) for name, given in (("scales", scales), ("colors", colors)))
    return list(zip(keypoints, *others, strict=True))


def _one_per_image(
    name: str, given: Sequence[ArrayLike | None] | None, count: int
) -> Sequence[ArrayLike | None]:
    if given is None:
        return [None] * count
    if len(given) != count:
        raise InvalidArgument(f"{name}: has {len(given)} entries, must have {count} as keypoints")
    return given


def _features(number: int, pixels: ArrayLike, scales: ArrayLike | None, colors: ArrayLike | None) -> Features:
    places = finite_array(f"keypoints[{number}]", pixels, (ANY, 2))
    count = len(places)
    unknown = np.full(count, np.nan)
    sizes = unknown if scales is None else _scales(number, scales, count)
    return Features(places, sizes, unknown, _colors(number, colors, count), np.empty((count, 0), np.uint8))


def _scales(number: int, scales: ArrayLike, count: int) -> FloatArray:
    values = shaped_array(f"scales[{number}]", scales, (count,))
    wrong = np.flatnonzero((values < 0) | np.isinf(values))
    if len(wrong):
        value = values[wrong[0]]
        raise InvalidArgument(
            f"scales[{number}][{wrong[0]}] = {value:g}: must be finite, not negative, or NaN"
        )
    return values


def _colors(number: int, colors: ArrayLike | None, count: int) -> NDArray[np.uint8]:
    if colors is None:
        return np.zeros((count, 3), np.uint8)
    values = finite_array(f"colors[{number}]", colors, (count, 3))
    if ((values < 0) | (values > 255)).any():
        raise InvalidArgument(f"colors[{number}]: must be from 0 to 255")
    return values.astype(np.uint8)


def _photos(
    features: Sequence[Features], sizes: ArrayLike | None, names: Sequence[str] | None
) -> list[Photo]:
    count = len(features)
    named = [f"{i:04d}" for i in range(count)] if names is None else [str(name) for name in names]
    if len(named) != count:
        raise InvalidArgument(f"names: has {len(named)} entries, must have {count} as keypoints")
    if len(set(named)) < count:
        twice = next(name for name in named if named.count(name) > 1)
        raise InvalidArgument(f"names: {twice!r} is there more than once, must be different")
    for name in named:
        if (fault := fault_of_image_name(name)) is not None:
            raise InvalidArgument(f"names: {name!r} {fault}")
    return [Photo(name, size=size) for name, size in zip(named, _sizes(features, sizes), strict=True)]


def _sizes(features: Sequence[Features], sizes: ArrayLike | None) -> list[tuple[int, int]]:
    if sizes is None:
        farthest = np.max([one.pixels.max(axis=0, initial=1.0) for one in features], axis=0)
        return [(int(np.ceil(farthest[0])), int(np.ceil(farthest[1])))] * len(features)
    given = finite_array("sizes", sizes, (len(features), 2))
    if (given < 1).any():
        number = int(np.flatnonzero((given < 1).any(axis=1))[0])
        raise InvalidArgument(f"sizes[{number}] = {given[number].tolist()}: must be at least 1 each")
    return [(int(width), int(height)) for width, height in given]


def _checked_pair(
    pair: ImagePair, found: ArrayLike, features: Sequence[Features]
) -> tuple[ImagePair, Matches]:
    """A pair with the lower number first, and its matches of these features; else InvalidArgument."""
    name = f"matches[{pair}]"
    try:
        i, j = (index(number) for number in pair)
    except (TypeError, ValueError):
        raise InvalidArgument(f"{name}: the key must be the numbers of two images") from None
    if i == j or not all(0 <= number < len(features) for number in (i, j)):
        raise InvalidArgument(f"{name}: must be of two different images from 0 to {len(features) - 1}")
    numbers = _checked_numbers(name, found, (len(features[i]), len(features[j])))
    return ((i, j), numbers) if i < j else ((j, i), np.ascontiguousarray(numbers[:, ::-1]))


def _checked_numbers(name: str, found: ArrayLike, counts: tuple[int, int]) -> Matches:
    values: FloatArray = finite_array(name, np.empty((0, 2)) if np.size(found) == 0 else found, (ANY, 2))
    for side, count in enumerate(counts):
        column = values[:, side]
        wrong = np.flatnonzero((column < 0) | (column >= count) | (column != np.floor(column)))
        if len(wrong):
            at, value = int(wrong[0]), column[wrong[0]]
            rule = f"must be the number of one of the {count} keypoints"
            raise InvalidArgument(f"{name}[{at}, {side}] = {value:g}: {rule}")
        if len(np.unique(column)) < len(column):
            ordered = np.sort(column)
            twice = ordered[:-1][np.diff(ordered) == 0][0]
            raise InvalidArgument(f"{name}: keypoint {twice:g} of column {side} matches more than one")
    return values.astype(np.int32)


@checked()
def match_graph_of_database(
    path: str | PathLike[str],
    *,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress = no_progress,
) -> MatchGraph:
    """Make a match graph of a database of COLMAP; only its two-view geometry is computed.

    Parameters
    ----------
    path : path-like
        ``database.db``; it is not changed.
    seed : int
        Of every random sample; same seed, same result.
    threads : int, optional
        Threads at most; the result does not depend on it. Default: as many as the process may use.
    progress : callable
        As of :func:`match_graph_of_arrays`.

    Returns
    -------
    MatchGraph
        Images in the order of their names, with the keypoints that COLMAP detected and the matches that it
        has verified (all matches where it has verified none). Images of one camera share it; its focal
        length counts where the files told it, and so do their positions if they are WGS84, with standard
        deviations from their covariances if each has one. A reconstruction keeps the identifiers of images
        and cameras, and the cameras' models unless another is asked for; `warnings` say what of the
        database is not used.

    Raises
    ------
    DatasetError
        If the file is missing, damaged or no such database, or a camera model is not supported.
    KeyboardInterrupt
        If `progress` asked to stop.
    """
    found = read_database(path)
    try:
        graph = match_graph_of_arrays(
            found.keypoints,
            {pair: unique_matches(some) for pair, some in found.matches.items()},
            [photo.size for photo in found.photos],
            [photo.name for photo in found.photos],
            found.scales,
            intrinsics=[
                None if photo.focal_px is None else camera.intrinsics
                for photo, camera in zip(found.photos, found.cameras, strict=True)
            ],
            seed=seed,
            threads=threads,
            progress=progress,
        )
    except InvalidArgument as error:
        raise DatasetError(path, str(error)) from error
    return replace(
        graph,
        photos=found.photos,
        image_ids=found.image_ids,
        cameras=found.cameras,
        warnings=[*graph.warnings, *found.unused],
    )
