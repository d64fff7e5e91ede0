"""Bundler's ``bundle.out``, version 0.3 (Snavely 2008).

After ``# Bundle file v0.3`` and ``cameras points``: five lines a camera (``f k1 k2``, three rows of
R, t; camera_from_world, looking along -z) and three lines a point (position, colour, then the number of
views and ``camera key x y`` for each, y up, from the centre of the image). All zeros: not registered.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import DatasetError
from sfmcpp.geometry.so3 import nearest_rotation
from sfmcpp.model import Metadata, Problem
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.checks import PRINTED_ROTATION_TOLERANCE, is_rotation
from sfmcpp.model.metadata import REGISTERED
from sfmcpp.sources.io.atomic import atomic_files
from sfmcpp.sources.io.checks import (
    LARGEST_COUNT,
    finite_rows,
    first_duplicate,
    point_colors,
    require_valid,
)
from sfmcpp.sources.io.files import read_text_bytes
from sfmcpp.sources.io.format import Format
from sfmcpp.sources.io.intrinsics import as_bal
from sfmcpp.sources.io.number_text import NumberText
from sfmcpp.sources.io.poses import cameras_from_y_up_pose, turned_pixels, y_up_pose_from_cameras
from sfmcpp.sources.io.rows import (
    Rows,
    by_point,
    format_ragged,
    format_rows,
    observation_keys,
    tokens_of_items,
)

MAGIC = b"# Bundle file v0.3"
KEYS = "bundler_keys"
_CAMERA_LINES, _CAMERA_NUMBERS, _POINT_LINES, _VIEW = 5, 15, 3, 4


def read_bundler(path: Path) -> Problem:
    """Read a Bundler file; camera model ``"bal"``, everything free.

    Rotations are made orthonormal again after their printing. Unregistered cameras (all zeros) are no cameras
    of the problem: where there are some, ``metadata.extra["bundler_registered"]`` tells which of the file's
    are, and ``metadata.image_names`` number them as the file does. Colours go to ``metadata.point_colors``,
    key numbers to ``metadata.extra["bundler_keys"]``.

    Raises
    ------
    DatasetError
        Naming the line at fault.
    """
    text = _text(path)
    num_cameras, num_points = _counts(text)
    _require_camera_lines(text, num_cameras)
    cameras = text.values[2 : 2 + _CAMERA_NUMBERS * num_cameras].reshape(-1, 5, 3)
    heads = text.lines.first[1 + _CAMERA_LINES * num_cameras :: _POINT_LINES]
    counts, views = _views(text, num_cameras)
    camera_index = text.integers(views, "camera index", 0, num_cameras - 1)
    point_index = np.repeat(np.arange(num_points), counts)
    _require_no_duplicates(text, views, first_duplicate(camera_index, point_index, num_cameras))
    poses, registered = _poses(text, cameras), np.asarray(cameras.any(axis=(1, 2)))
    _require_registered(text, views, registered[camera_index])
    metadata = Metadata("bundler", point_colors=_colors(text, heads))
    metadata.extra[KEYS] = text.integers(views + 1, "key number", 0, LARGEST_COUNT)
    if not registered.all():
        metadata.extra[REGISTERED] = registered
        metadata.image_names = [f"image_{number:06d}" for number in np.flatnonzero(registered) + 1]
    return Problem(
        "bal",
        poses[registered],
        cameras[registered, 0],
        text.values[heads[:, None] + np.arange(3)],
        (np.cumsum(registered) - 1)[camera_index].astype(np.int32),
        point_index.astype(np.int32),
        turned_pixels(text.values[views[:, None] + np.array([2, 3])]),
        metadata=metadata,
    )


def write_bundler(problem: Problem, path: Path) -> None:
    """Write a Bundler file; masks, standard deviations and covariances are not kept.

    Without key numbers in the metadata the observations of each image are numbered from 0; without colours
    points are black. Cameras with a principal point have it subtracted from their pixels. Cameras that were
    not registered when the problem was read are written as such.

    Raises
    ------
    DatasetError
        If the intrinsics do not fit f, k1, k2, or the file cannot be written.
    """
    require_valid(problem, path)
    intrinsics, pixels = as_bal(problem, "a Bundler file", path)
    registered = _registered_cameras(problem, path)
    with atomic_files(path) as (stream,):
        stream.write(MAGIC + f"\n{len(registered)} {problem.num_points}\n".encode("ascii"))
        stream.writelines(_camera_chunks(problem, intrinsics, registered))
        stream.writelines(_point_chunks(problem, turned_pixels(pixels), registered, path))


def _text(path: Path) -> NumberText:
    data = read_text_bytes(path)
    if not data.startswith(MAGIC):
        raise DatasetError(path, f"the first line must be '{MAGIC.decode()}'", 1)
    return NumberText(path, data, comments=True)


def _counts(text: NumberText) -> tuple[int, int]:
    if len(text.values) < 2:
        raise text.error("truncated: the header needs two counts (cameras, points)", 0)
    text.require_line_counts(text.lines.count[:1] == 2, "2 (cameras, points)")
    cameras = int(text.integers(slice(0, 1), "number of cameras", 0, LARGEST_COUNT)[0])
    points = int(text.integers(slice(1, 2), "number of points", 0, LARGEST_COUNT)[0])
    present, wanted = len(text.lines.count), 1 + _CAMERA_LINES * cameras + _POINT_LINES * points
    if present != wanted:
        fault = "truncated" if present < wanted else "trailing garbage"
        line = int(text.lines.number[min(wanted, present - 1)])
        reason = f"{fault}: {cameras} cameras, {points} points take {wanted} lines, the file has {present}"
        raise DatasetError(text.path, reason, line)
    return cameras, points


def _require_camera_lines(text: NumberText, num_cameras: int) -> None:
    good = np.ones(len(text.lines.count), dtype=np.bool_)
    cameras_end = 1 + _CAMERA_LINES * num_cameras
    good[1:cameras_end] = text.lines.count[1:cameras_end] == 3
    for offset in (0, 1):
        rows = slice(cameras_end + offset, None, _POINT_LINES)
        good[rows] = text.lines.count[rows] == 3
    text.require_line_counts(good, "3")


def _views(text: NumberText, num_cameras: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """How many views each point has, and the index of the first number of every view."""
    rows = slice(3 + _CAMERA_LINES * num_cameras, None, _POINT_LINES)
    first = text.lines.first[rows]
    counts = text.integers(first, "number of views", 0, LARGEST_COUNT)
    good = np.ones(len(text.lines.count), dtype=np.bool_)
    good[rows] = text.lines.count[rows] == 1 + _VIEW * counts
    text.require_line_counts(good, "1 + 4 for each of the views announced by the first")
    return counts, tokens_of_items(first + 1, counts, _VIEW)


def _colors(text: NumberText, heads: NDArray[np.int64]) -> NDArray[np.uint8]:
    tokens = (heads[:, None] + np.arange(3, 6)).ravel()
    return text.integers(tokens, "colour", 0, 255).astype(np.uint8).reshape(-1, 3)


def _require_no_duplicates(
    text: NumberText, views: NDArray[np.int64], duplicate: tuple[int, int] | None
) -> None:
    if duplicate is not None:
        camera = int(text.values[views[duplicate[1]]])
        raise text.error(f"camera {camera} observes this point twice", int(views[duplicate[1]]))


def _require_registered(text: NumberText, views: NDArray[np.int64], good: BoolArray) -> None:
    if not good.all():
        token = int(views[np.argmin(good)])
        reason = f"camera {text.values[token]:.0f} observes this point, and is all zeros: not registered"
        raise text.error(reason, token)


def _poses(text: NumberText, cameras: FloatArray) -> FloatArray:
    rotations, translations = cameras[:, 1:4].copy(), cameras[:, 4]
    unregistered = ~cameras.any(axis=(1, 2))
    rotations[unregistered] = np.diag([1.0, -1.0, -1.0])
    good = is_rotation(rotations, PRINTED_ROTATION_TOLERANCE)
    if not good.all():
        row = int(np.argmin(good))
        raise text.error(f"camera {row}: its 3x3 matrix is not a rotation", 5 + _CAMERA_NUMBERS * row)
    with np.errstate(all="ignore"):
        poses = cameras_from_y_up_pose(nearest_rotation(rotations), translations)
    return _require_finite(text, poses)


def _require_finite(text: NumberText, poses: FloatArray) -> FloatArray:
    finite = finite_rows(poses)
    if not finite.all():
        row = int(np.argmin(finite))
        raise text.error(f"camera {row}: its translation is too large", 14 + _CAMERA_NUMBERS * row)
    return poses


def _registered_cameras(problem: Problem, path: Path) -> BoolArray:
    """Which cameras of the file are those of the problem."""
    registered = problem.metadata.extra.get(REGISTERED)
    if registered is None:
        return np.ones(problem.num_cameras, dtype=np.bool_)
    mask = np.asarray(registered, dtype=np.bool_)
    if np.count_nonzero(mask) != problem.num_cameras:
        fault = f"metadata {REGISTERED} tells of {np.count_nonzero(mask)} cameras"
        raise DatasetError(path, f"{fault}: must be {problem.num_cameras}")
    return mask


def _camera_chunks(problem: Problem, intrinsics: FloatArray, registered: BoolArray) -> Iterator[bytes]:
    rotations, translations = y_up_pose_from_cameras(problem.cameras)
    numbers = np.zeros((len(registered), _CAMERA_NUMBERS))
    numbers[registered] = np.concatenate([intrinsics, rotations.reshape(-1, 9), translations], axis=1)
    yield from format_rows("%r %r %r\n", *numbers.reshape(-1, 3).T)


def _point_chunks(problem: Problem, pixels: FloatArray, registered: BoolArray, path: Path) -> Iterator[bytes]:
    order, counts = by_point(problem)
    colors = point_colors(problem, (0, 0, 0), path)
    keys = observation_keys(problem, KEYS, path)
    heads = Rows("%r %r %r\n%d %d %d\n%d", (*problem.points.T, *colors.T, counts))
    cameras = np.flatnonzero(registered)[problem.camera_index]
    views = Rows(" %d %d %r %r", (cameras, keys, *pixels.T))
    return format_ragged(heads, views, counts, "\n", order)


FORMAT = Format(
    "bundler",
    "Bundler v0.3, bundle.out",
    (".out",),
    read_bundler,
    write_bundler,
    lacks=(
        "origin of the world",
        "keypoints without a point",
        "image names",
        "image sizes",
        "masks",
        "rigid frames",
        "shared intrinsics",
        "uncertainties of observations",
    ),
)
