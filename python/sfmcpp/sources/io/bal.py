"""Bundle Adjustment in the Large (Agarwal, Snavely, Seitz, Szeliski 2010), plain or compressed.

Header ``cameras points observations``; a line ``camera point u v`` for each observation; then nine
numbers a camera (angle-axis and translation of camera_from_world, f, k1, k2) and three a point. The
camera looks along -z, pixels have y up and their origin at the principal point.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from sfmcpp.geometry.quaternions import angle_axis_from_rotation, rotation_from_angle_axis
from sfmcpp.model import Metadata, Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sources.io.checks import LARGEST_COUNT, finite_rows, first_duplicate, require_valid
from sfmcpp.sources.io.files import COMPRESSED_SUFFIXES, atomic_files, compressed_writer, read_bytes
from sfmcpp.sources.io.format import Format
from sfmcpp.sources.io.intrinsics import as_bal
from sfmcpp.sources.io.number_text import NumberText
from sfmcpp.sources.io.poses import cameras_from_y_up_pose, turned_pixels, y_up_pose_from_cameras
from sfmcpp.sources.io.rows import format_rows

_HEADER, _OBSERVATION, _CAMERA, _POINT = 3, 4, 9, 3


def read_bal(path: Path) -> Problem:
    """Read a BAL file; camera model ``"bal"``, everything free.

    Raises
    ------
    DatasetError
        Naming the line, if anything is not a finite number, a count or an index is impossible, there are
        more or fewer numbers than the header says, or two lines observe the same point by the same camera.
    """
    text = NumberText(path, read_bytes(path))
    num_cameras, num_points, num_observations = _counts(text)
    cameras_at = _HEADER + _OBSERVATION * num_observations
    points_at = cameras_at + _CAMERA * num_cameras
    observations = text.values[_HEADER:cameras_at].reshape(-1, _OBSERVATION)
    camera_index = text.integers(slice(3, cameras_at, 4), "camera index", 0, num_cameras - 1)
    point_index = text.integers(slice(4, cameras_at, 4), "point index", 0, num_points - 1)
    _require_no_duplicates(text, first_duplicate(camera_index, point_index, num_cameras))
    cameras = text.values[cameras_at:points_at].reshape(-1, _CAMERA)
    return Problem(
        "bal",
        _poses(text, cameras, cameras_at),
        cameras[:, 6:].copy(),
        text.values[points_at:].reshape(-1, _POINT).copy(),
        camera_index.astype(np.int32),
        point_index.astype(np.int32),
        turned_pixels(observations[:, 2:]),
        metadata=Metadata(source_format="bal"),
    )


def write_bal(problem: Problem, path: Path) -> None:
    """Write a BAL file, compressed as its suffix says.

    Masks, standard deviations and covariances are not kept. Cameras with a principal point have it
    subtracted from their pixels.

    Raises
    ------
    DatasetError
        If the intrinsics do not fit f, k1, k2, or the file cannot be written.
    """
    require_valid(problem, path)
    intrinsics, pixels = as_bal(problem, "BAL", path)
    with atomic_files(path) as (raw,), compressed_writer(raw, path) as stream:
        for chunk in _chunks(problem, intrinsics, turned_pixels(pixels)):
            stream.write(chunk.encode("ascii"))


def _counts(text: NumberText) -> tuple[int, int, int]:
    present = len(text.values)
    if present < _HEADER:
        raise text.error("truncated: the header needs three counts (cameras, points, observations)", present)
    names = ("number of cameras", "number of points", "number of observations")
    cameras, points, observations = (
        int(text.integers(slice(i, i + 1), name, 0, LARGEST_COUNT)[0]) for i, name in enumerate(names)
    )
    wanted = _HEADER + _OBSERVATION * observations + _CAMERA * cameras + _POINT * points
    if present != wanted:
        fault = "truncated" if present < wanted else "trailing garbage"
        counts = f"{cameras} cameras, {points} points, {observations} observations"
        raise text.error(f"{fault}: {counts} take {wanted} numbers, the file has {present}", wanted)
    return cameras, points, observations


def _require_no_duplicates(text: NumberText, duplicate: tuple[int, int] | None) -> None:
    if duplicate is None:
        return
    first, second = (_HEADER + _OBSERVATION * row for row in duplicate)
    raise text.error(f"observes the same point by the same camera as line {text.line_of(first)}", second)


def _poses(text: NumberText, cameras: FloatArray, start: int) -> FloatArray:
    with np.errstate(all="ignore"):
        poses = cameras_from_y_up_pose(rotation_from_angle_axis(cameras[:, :3]), cameras[:, 3:6])
    finite = finite_rows(poses)
    if not finite.all():
        row = int(np.argmin(finite))
        raise text.error(f"camera {row}: the numbers of its pose are too large", start + _CAMERA * row)
    return poses


def _chunks(problem: Problem, intrinsics: FloatArray, pixels: FloatArray) -> Iterator[str]:
    rotations, translations = y_up_pose_from_cameras(problem.cameras)
    vectors = angle_axis_from_rotation(rotations)
    yield f"{problem.num_cameras} {problem.num_points} {problem.num_observations}\n"
    yield from format_rows("%d %d %r %r\n", problem.camera_index, problem.point_index, *pixels.T)
    yield from format_rows("%r\n", np.concatenate([vectors, translations, intrinsics], axis=1).ravel())
    yield from format_rows("%r\n", problem.points.ravel())


FORMAT = Format(
    "bal",
    "Bundle Adjustment in the Large, plain or compressed",
    (".txt", *(f".txt{suffix}" for suffix in COMPRESSED_SUFFIXES)),
    read_bal,
    write_bal,
)
