"""Bundle adjustments of g2o (Kümmerle, Grisetti, Strasdat, Konolige & Burgard 2011), both of its dialects.

A line is a word and numbers. Points are ``VERTEX_XYZ`` or ``VERTEX_TRACKXYZ id x y z``; a pose is ``tx ty tz
qx qy qz qw``, world_from_camera, z forward and y down. ``VERTEX_CAM id pose fx fy cx cy baseline`` has
intrinsics of its own and is observed by ``EDGE_PROJECT_P2MC point camera u v information``. Those of
``VERTEX_SE3:EXPMAP id pose`` are ``PARAMS_CAMERAPARAMETERS id f cx cy baseline``, which its observations
name: ``EDGE_PROJECT_XYZ2UV:EXPMAP point camera parameters u v information``. The information is Σ⁻¹ [1/px²],
its upper triangle by rows. ``FIX id …`` holds vertices.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import DatasetError
from sfmcpp.geometry.pinhole import PINHOLE
from sfmcpp.geometry.so3 import quaternion_from_rotation, rotation_from_quaternion
from sfmcpp.model import Metadata, Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.camera_models import PERSPECTIVE
from sfmcpp.model.selection import observing_cameras
from sfmcpp.sources.io.atomic import atomic_files
from sfmcpp.sources.io.checks import LARGEST_COUNT, first_duplicate, require_valid
from sfmcpp.sources.io.files import read_text_bytes
from sfmcpp.sources.io.format import Format
from sfmcpp.sources.io.intrinsics import (
    as_perspective,
    fixed_but,
    has_distortion,
    perspective_columns,
    perspective_rows,
    require_defaults_except,
    require_positive_lengths,
    undistorted,
)
from sfmcpp.sources.io.number_text import NumberText
from sfmcpp.sources.io.rows import format_rows, tokens_of_items

Int64Array = NDArray[np.int64]

IDS = "g2o_point_ids"
_FIX, _LENS = b"FIX", b"PARAMS_CAMERAPARAMETERS"
_POINTS = (b"VERTEX_XYZ", b"VERTEX_TRACKXYZ")
_OWN_LENS, _NAMED_LENS = b"VERTEX_CAM", b"VERTEX_SE3:EXPMAP"
_OF_OWN_LENS, _OF_NAMED_LENS = b"EDGE_PROJECT_P2MC", b"EDGE_PROJECT_XYZ2UV:EXPMAP"
# Of each word, how many numbers follow it.
_NUMBERS = {
    _POINTS[0]: 4,
    _POINTS[1]: 4,
    _LENS: 5,
    _OWN_LENS: 13,
    _NAMED_LENS: 8,
    _OF_OWN_LENS: 7,
    _OF_NAMED_LENS: 8,
}
_WORDS = [*_NUMBERS, _FIX]
_LENS_NAMES = ("f", "aspect", "cx", "cy")
_DIGITS = len(str(LARGEST_COUNT))


def read_g2o(path: Path) -> Problem:
    """Read a problem of points and cameras; camera model ``"perspective"``, intrinsics fixed as g2o has them.

    ``metadata.extra["g2o_point_ids"]`` has the identifiers of the points; images are named by those of the
    cameras. Baselines are not used: observations of stereo cameras are refused.

    Raises
    ------
    DatasetError
        Naming the line at fault: a word that is no part of a bundle adjustment of single images, an unknown
        identifier, an information that is not positive definite.
    """
    records = _Records(path)
    points, cameras = _Vertices(records, *_POINTS), _Vertices(records, _OWN_LENS, _NAMED_LENS)
    named = bool(len(records.first(_NAMED_LENS)))
    if named and len(records.first(_OWN_LENS)):
        token = int(records.first(_OWN_LENS)[0])
        raise records.text.error(f"VERTEX_CAM beside {_NAMED_LENS.decode()}: must be one of them", token)
    edges = records.first(_OF_NAMED_LENS if named else _OF_OWN_LENS)
    _require_no_others(records, _OF_OWN_LENS if named else _OF_NAMED_LENS)
    point_index, camera_index = points.rows_of(edges), cameras.rows_of(edges + 1)
    _require_no_duplicate(records.text, edges, camera_index, point_index, len(cameras.ids))
    intrinsics, intrinsics_index = (
        _named_lenses(records, edges, camera_index, len(cameras.ids))
        if named
        else (_own_lenses(records), np.arange(len(cameras.ids), dtype=np.int32))
    )
    measured = records.numbers(edges + (3 if named else 2), 5)
    held = _Held(records, points, cameras)
    return Problem(
        "perspective",
        _poses(records.text, cameras.first),
        intrinsics,
        records.numbers(points.first + 1, 3),
        camera_index.astype(np.int32),
        point_index.astype(np.int32),
        measured[:, :2].copy(),
        intrinsics_index=intrinsics_index,
        covariance_px2=_covariances(records.text, edges, measured[:, 2:]),
        fixed_cameras=held.cameras,
        fixed_points=held.points,
        fixed_intrinsics=fixed_but(len(intrinsics)),
        metadata=Metadata("g2o", image_names=[str(i) for i in cameras.ids], extra={IDS: points.ids}),
    )


class _Records:
    """The lines of a file, found by their words; in the text of numbers a word is its place in ``_WORDS``."""

    def __init__(self, path: Path) -> None:
        self.text = NumberText(path, _numbered(path), comments=True)
        self._heads = self.text.lines.first
        self._words = self.text.values[self._heads].astype(np.int64)
        wanted = np.array([*_NUMBERS.values(), -1])[self._words]
        good = (wanted < 0) | (self.text.lines.count == wanted + 1)
        if not good.all():
            line = int(np.argmin(good))
            reason = f"{_WORDS[self._words[line]].decode()} takes {wanted[line]} numbers"
            raise self.text.error(
                f"{reason}, there are {self.text.lines.count[line] - 1}", int(self._heads[line])
            )

    def first(self, *words: bytes) -> Int64Array:
        """Index of the first number of each line that begins with one of these words."""
        return self._heads[np.isin(self._words, [_WORDS.index(word) for word in words])] + 1

    def numbers(self, first: Int64Array, count: int) -> FloatArray:
        """So many numbers (n, count) from each of these places on."""
        return np.asarray(self.text.values[first[:, None] + np.arange(count)].reshape(-1, count))

    def held(self) -> Int64Array:
        """Index of every number of the lines FIX."""
        lines = self._words == _WORDS.index(_FIX)
        return tokens_of_items(self._heads[lines] + 1, self.text.lines.count[lines] - 1, 1)


def _numbered(path: Path) -> bytes:
    """The file with a number in place of the word of each line."""
    numbers = {word: b"%d " % place for place, word in enumerate(_WORDS)}
    lines = read_text_bytes(path).split(b"\n")
    for row, line in enumerate(lines):
        words = line.split(None, 1)
        if not words or words[0].startswith(b"#"):
            continue
        if words[0] not in numbers:
            word = words[0][:40].decode("utf-8", "replace")
            known = ", ".join(known.decode() for known in _WORDS)
            raise DatasetError(
                path, f"{word!r} is no part of a bundle adjustment that can be read: {known}", row + 1
            )
        lines[row] = numbers[words[0]] + b"".join(words[1:])
    return b"\n".join(lines)


class _Vertices:
    """Vertices by their identifiers, in the order of the file."""

    def __init__(self, records: _Records, *words: bytes) -> None:
        self._text = records.text
        self.first = records.first(*words)
        self.ids = _identifiers(self._text, self.first)
        self._order = np.argsort(self.ids, kind="stable")
        twice = np.flatnonzero(np.diff(self.ids[self._order]) == 0)
        if len(twice):
            row = int(self._order[twice[0] + 1])
            raise self._text.error(f"id {self.ids[row]} is used twice", int(self.first[row]))

    def find(self, ids: Int64Array) -> Int64Array:
        """Rows of identifiers, -1 where there is no such vertex."""
        places = np.searchsorted(self.ids, ids, sorter=self._order)
        rows = np.append(self._order, -1)[places]
        return np.asarray(np.where(np.append(self.ids, -1)[rows] == ids, rows, -1))

    def rows_of(self, tokens: Int64Array) -> Int64Array:
        """Rows of the identifiers that stand at these places of the text."""
        ids = _identifiers(self._text, tokens)
        rows = self.find(ids)
        if (rows < 0).any():
            bad = int(np.argmin(rows))
            raise self._text.error(f"id {ids[bad]} is not that of such a vertex", int(tokens[bad]))
        return rows


class _Held:
    """Masks of the vertices that are held."""

    def __init__(self, records: _Records, points: _Vertices, cameras: _Vertices) -> None:
        tokens = records.held()
        ids = _identifiers(records.text, tokens)
        unknown = (points.find(ids) < 0) & (cameras.find(ids) < 0)
        if unknown.any():
            bad = int(np.argmax(unknown))
            raise records.text.error(f"id {ids[bad]} is not that of a vertex", int(tokens[bad]))
        self.points, self.cameras = np.isin(points.ids, ids), np.isin(cameras.ids, ids)


def _identifiers(text: NumberText, tokens: Int64Array) -> Int64Array:
    return text.integers(tokens, "id", 0, LARGEST_COUNT)


def _require_no_others(records: _Records, edge: bytes) -> None:
    others = records.first(edge)
    if len(others):
        raise records.text.error(
            f"{edge.decode()}: the cameras of this file are of the other kind", int(others[0])
        )


def _require_no_duplicate(
    text: NumberText, edges: Int64Array, camera_index: Int64Array, point_index: Int64Array, num_cameras: int
) -> None:
    duplicate = first_duplicate(camera_index, point_index, num_cameras)
    if duplicate is not None:
        raise text.error("the camera observes this point twice", int(edges[duplicate[1]]))


def _own_lenses(records: _Records) -> FloatArray:
    """Intrinsics (C, K) of cameras that have their own."""
    first = records.first(_OWN_LENS)
    fx, fy, cx, cy = records.numbers(first + 8, 4).T
    return _perspective(records.text, first + 8, fx, fy, cx, cy)


def _named_lenses(
    records: _Records, edges: Int64Array, camera_index: Int64Array, num_cameras: int
) -> tuple[FloatArray, NDArray[np.int32]]:
    """Intrinsics (G, K) by name, and which of them each camera has: what all of its observations say."""
    lenses = _Vertices(records, _LENS)
    if not len(lenses.ids):
        raise records.text.error(f"there is no {_LENS.decode()}", 0)
    f, cx, cy = records.numbers(lenses.first + 1, 3).T
    named = lenses.rows_of(edges + 2)
    rows = np.zeros(num_cameras, dtype=np.int32)
    rows[camera_index] = named
    differs = rows[camera_index] != named
    if differs.any():
        token = int(edges[np.argmax(differs)]) + 2
        raise records.text.error("observations of this camera name different intrinsics: must be one", token)
    return _perspective(records.text, lenses.first + 1, f, f, cx, cy), rows


def _perspective(
    text: NumberText, first: Int64Array, fx: FloatArray, fy: FloatArray, cx: FloatArray, cy: FloatArray
) -> FloatArray:
    with np.errstate(all="ignore"):
        aspect = fy / fx
    good = (fx > 0) & (fy > 0) & (aspect > 0) & np.isfinite(aspect)
    if not good.all():
        raise text.error("focal lengths must be positive", int(first[np.argmin(good)]))
    rows = perspective_rows(len(first))
    rows[:, perspective_columns("f", "aspect", "cx", "cy")] = np.column_stack([fx, aspect, cx, cy])
    return rows


def _poses(text: NumberText, first: Int64Array) -> FloatArray:
    numbers = text.values[first[:, None] + np.arange(1, 8)].reshape(-1, 7)
    good = numbers[:, 3:].any(axis=1)
    if not good.all():
        raise text.error("the quaternion is zero", int(first[np.argmin(good)]))
    rotations = rotation_from_quaternion(numbers[:, [6, 3, 4, 5]])
    return np.concatenate([rotations, numbers[:, :3, None]], axis=2)


def _covariances(text: NumberText, edges: Int64Array, information: FloatArray) -> FloatArray | None:
    """Σ (M, 2, 2) of a, b, c (M, 3) in ``Σ⁻¹ = [a b; b c]``, or None where all are of one pixel."""
    if np.array_equal(information, np.tile([1.0, 0.0, 1.0], (len(information), 1))):
        return None
    a, b, c = information.T
    with np.errstate(all="ignore"):
        determinant = a * c - b * b
        covariances = np.stack([c, -b, -b, a], axis=1).reshape(-1, 2, 2) / determinant[:, None, None]
    good = (a > 0) & (determinant > 0) & np.isfinite(covariances).all(axis=(1, 2))
    if not good.all():
        raise text.error("the information is not positive definite", int(edges[np.argmin(good)]))
    return np.asarray(covariances)


def write_g2o(problem: Problem, path: Path) -> None:
    """Write points, cameras, what of them is held, and observations with their information.

    Intrinsics are named where all aspect ratios are 1 and observations tell whose they are, else each camera
    has its own; neither has a place for distortion: pixels are where cameras without it would have seen them.
    Images whose names are identifiers keep them, and so do points that were read; otherwise cameras are
    numbered from 0, and points behind them.

    Raises
    ------
    DatasetError
        If there are no cameras and no points, there is skew, a focal length is not positive, or the file
        cannot be written.
    """
    require_valid(problem, path)
    if not problem.num_cameras and not problem.num_points:
        raise DatasetError(path, "g2o's files cannot hold a problem without cameras and without points")
    values, _ = as_perspective(problem)
    require_defaults_except(values, (*_LENS_NAMES, *PERSPECTIVE[PINHOLE:]), "g2o's files", path)
    require_positive_lengths(values, path)
    if has_distortion(problem):
        problem = undistorted(problem, values)
    with atomic_files(path) as (stream,):
        stream.writelines(_chunks(problem, values[:, perspective_columns(*_LENS_NAMES)]))


def _written_ids(problem: Problem) -> tuple[Int64Array, Int64Array]:
    """Identifiers of cameras and points: those that are known if all differ, else counted."""
    count, total = problem.num_cameras, problem.num_cameras + problem.num_points
    names = problem.metadata.image_names
    cameras = [int(name) if name.isdecimal() and len(name) <= _DIGITS else -1 for name in names]
    points = np.asarray(problem.metadata.extra.get(IDS, ()), dtype=np.int64)
    known = np.concatenate([np.array(cameras, dtype=np.int64), points])
    good = len(cameras) == count and len(points) == problem.num_points and len(np.unique(known)) == total
    if not (good and ((known >= 0) & (known <= LARGEST_COUNT)).all()):
        known = np.arange(total)
    return known[:count], known[count:]


def _chunks(problem: Problem, lenses: FloatArray) -> Iterator[bytes]:
    f, aspect, cx, cy = lenses.T
    named, rows = bool((aspect == 1).all()) and _observations_tell_lenses(problem), problem.intrinsics_index
    cameras, points = _written_ids(problem)
    seen_points, seen_cameras = points[problem.point_index], cameras[problem.camera_index]
    poses = (cameras, *problem.centres.T, *quaternion_from_rotation(problem.rotations)[:, [1, 2, 3, 0]].T)
    if named:
        yield from _lines(_LENS, np.arange(len(f)), f, cx, cy, np.zeros(len(f)))
        yield from _lines(_NAMED_LENS, *poses)
    else:
        own = np.stack([f, f * aspect, cx, cy, np.zeros(len(f))])
        yield from _lines(_OWN_LENS, *poses, *own[:, rows])
    yield from _lines(_POINTS[1], points, *problem.points.T)
    yield from _lines(_FIX, np.concatenate([cameras[problem.fixed_cameras], points[problem.fixed_points]]))
    measured = (*problem.pixels.T, *_information(problem))
    if named:
        yield from _lines(_OF_NAMED_LENS, seen_points, seen_cameras, rows[problem.camera_index], *measured)
    else:
        yield from _lines(_OF_OWN_LENS, seen_points, seen_cameras, *measured)


def _observations_tell_lenses(problem: Problem) -> bool:
    """Whether lenses that observations name are told of all cameras; one that sees nothing has the first."""
    return not problem.intrinsics_index[~observing_cameras(problem)].any()


def _lines(word: bytes, *columns: NDArray[Any]) -> Iterator[bytes]:
    numbers = " ".join("%r" if column.dtype.kind == "f" else "%d" for column in columns)
    return format_rows(f"{word.decode()} {numbers}\n", *columns)


def _information(problem: Problem) -> tuple[FloatArray, ...]:
    """The upper triangle of Σ⁻¹ of each observation, by rows."""
    a = c = np.ones(problem.num_observations)
    b = np.zeros(problem.num_observations)
    if problem.sigma_px is not None:
        a = c = problem.sigma_px**-2
    if problem.covariance_px2 is not None:
        a, b, c = np.linalg.inv(problem.covariance_px2).reshape(-1, 4)[:, [0, 1, 3]].T
    return a, b, c


FORMAT = Format(
    "g2o",
    "bundle adjustments of g2o, .g2o",
    (".g2o",),
    read_g2o,
    write_g2o,
    undistorts=True,
    lacks=(
        "origin of the world",
        "keypoints without a point",
        "image names",
        "image sizes",
        "colours",
        "rigid frames",
    ),
)
