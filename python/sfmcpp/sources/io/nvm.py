"""VisualSFM's ``.nvm``, format NVM_V3 (C. Wu, http://ccwu.me/vsfm/doc.html#nvm).

After ``NVM_V3`` the number of cameras and a line for each: ``name f qw qx qy qz X Y Z r 0`` with a rotation
camera_from_world, z forward and y down, and a centre; then the number of points and a line for each:
position, colour, and the number of its measurements, each ``camera key x y`` from the middle of the image.
Further models follow in the same way, a 0, and what is no part of a model.

Distortion is of measurements: ``(1 + r |m|² / f²) m`` are the pixels of a camera without it (C. Wu et al.,
Multicore Bundle Adjustment, CVPR 2011, whose cost is of these).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import DatasetError
from sfmcpp.geometry.pinhole import PINHOLE, to_normalised, undistorted_pixels
from sfmcpp.geometry.so3 import quaternion_from_rotation, rotation_from_quaternion
from sfmcpp.model import Metadata, Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sources.io.atomic import atomic_files
from sfmcpp.sources.io.checks import (
    LARGEST_COUNT,
    fault_of_image_name,
    finite_rows,
    first_duplicate,
    image_names,
    point_colors,
    require_valid,
)
from sfmcpp.sources.io.files import read_text_bytes
from sfmcpp.sources.io.format import Format
from sfmcpp.sources.io.intrinsics import as_perspective, require_positive_lengths
from sfmcpp.sources.io.number_text import NumberText
from sfmcpp.sources.io.poses import cameras_from_pose
from sfmcpp.sources.io.rows import (
    Rows,
    by_point,
    format_ragged,
    format_rows,
    observation_keys,
    tokens_of_items,
)

DISTORTION, KEYS = "nvm_measurement_distortion", "nvm_keys"
_MAGIC = re.compile(rb"NVM_V3[ \t\r]*\Z")
_CAMERA, _POINT, _VIEW = 10, 7, 4


def read_nvm(path: Path) -> Problem:
    """Read a file with one model; camera model ``"bal"``, pixels from the middle of the image.

    Pixels are without the distortion of the measurements, so that k1 and k2 are 0: the cost is VisualSFM's.
    ``metadata.extra["nvm_measurement_distortion"]`` has r of each camera, ``["nvm_keys"]`` the keys.

    Raises
    ------
    DatasetError
        Naming the line at fault; if there are several models, a calibration for all (``FixedK``), or
        matrices in place of quaternions (``NVM_V3_R9T``).
    """
    text, names = _text(path)
    cameras = text.values[1 : 1 + _CAMERA * len(names)].reshape(-1, _CAMERA)
    heads, counts, views = _points(text, len(names))
    camera_index = text.integers(views, "camera index", 0, len(names) - 1)
    point_index = np.repeat(np.arange(len(heads)), counts)
    duplicate = first_duplicate(camera_index, point_index, len(names))
    if duplicate is not None:
        token = int(views[duplicate[1]])
        raise text.error(f"camera {text.values[token]:.0f} observes this point twice", token)
    colors = text.integers((heads[:, None] + np.arange(3, 6)).ravel(), "colour", 0, 255)
    metadata = Metadata("nvm", image_names=names, point_colors=colors.astype(np.uint8).reshape(-1, 3))
    metadata.extra[KEYS] = text.integers(views + 1, "key", 0, LARGEST_COUNT)
    metadata.extra[DISTORTION] = cameras[:, 8].copy()
    intrinsics = np.zeros((len(names), 3))
    intrinsics[:, 0] = _focal_lengths(text, cameras)
    return Problem(
        "bal",
        _poses(text, cameras),
        intrinsics,
        text.values[heads[:, None] + np.arange(3)].reshape(-1, 3),
        camera_index.astype(np.int32),
        point_index.astype(np.int32),
        _pixels(text, views, cameras[camera_index]),
        metadata=metadata,
    )


def _text(path: Path) -> tuple[NumberText, list[str]]:
    """Numbers behind the first line, and the names of the images, which are not among them."""
    first, *lines = read_text_bytes(path).split(b"\n")
    if not _MAGIC.match(first):
        raise DatasetError(path, "the first line must be NVM_V3, and no more", 1)
    rows = [i for i, line in enumerate(lines) if line.strip() and not line.lstrip().startswith(b"#")]
    if not rows:
        raise DatasetError(path, "truncated: there is no number of cameras", 1)
    count = NumberText(path, lines[rows[0]], before=rows[0] + 1)
    count.require_line_counts(count.lines.count == 1, "1 (cameras)")
    cameras = int(count.integers(slice(0, 1), "number of cameras", 0, LARGEST_COUNT)[0])
    if len(rows) < cameras + 2:
        raise DatasetError(path, f"truncated: {cameras} cameras and their points are wanted", len(lines) + 1)
    names = []
    for row in rows[1 : 1 + cameras]:
        name, lines[row] = _name_and_numbers(path, lines[row], row + 2)
        names.append(name)
    return NumberText(path, b"\n".join(lines), comments=True, before=1), names


def _name_and_numbers(path: Path, line: bytes, number: int) -> tuple[str, bytes]:
    words = line.rsplit(None, _CAMERA)
    if len(words) != _CAMERA + 1:
        raise DatasetError(path, f"the line must hold a name and {_CAMERA} numbers", number)
    try:
        return words[0].strip().decode("utf-8"), b" ".join(words[1:])
    except UnicodeDecodeError as error:
        raise DatasetError(path, f"the image name is not UTF-8 ({error.reason})", number) from error


def _points(text: NumberText, cameras: int) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """First number of each point, how many measurements each has, and the first number of each of these."""
    lines, row = text.lines, 1 + cameras
    good = np.ones(len(lines.count), dtype=np.bool_)
    good[1:row] = lines.count[1:row] == _CAMERA
    good[row] = lines.count[row] == 1
    text.require_line_counts(good, f"{_CAMERA} of a camera, or the number of points")
    token = int(lines.first[row])
    points = int(text.integers(slice(token, token + 1), "number of points", 0, LARGEST_COUNT)[0])
    own = slice(row + 1, row + 1 + points)
    if len(lines.first) < own.stop:
        raise text.error(f"truncated: {points} points are wanted", len(text.values))
    _require_end(text, own.stop)
    good = np.ones(len(lines.count), dtype=np.bool_)
    good[own] = lines.count[own] >= _POINT
    text.require_line_counts(good, f"{_POINT} and 4 for each measurement")
    heads = lines.first[own]
    counts = text.integers(heads + 6, "number of measurements", 0, LARGEST_COUNT)
    good[own] = lines.count[own] == _POINT + _VIEW * counts
    text.require_line_counts(good, f"{_POINT} and 4 for each measurement announced by the last of them")
    return heads, counts, tokens_of_items(heads + _POINT, counts, _VIEW)


def _require_end(text: NumberText, row: int) -> None:
    """Refuse what follows a model unless it is the 0 that ends them."""
    if len(text.lines.first) > row and text.values[text.lines.first[row]] != 0:
        raise text.error("another model begins here: a file must have one", int(text.lines.first[row]))


def _focal_lengths(text: NumberText, cameras: FloatArray) -> FloatArray:
    good = cameras[:, 0] > 0
    if not good.all():
        row = int(np.argmin(good))
        raise text.error(f"focal length {cameras[row, 0]:g}: must be positive", 1 + _CAMERA * row)
    return cameras[:, 0]


def _poses(text: NumberText, cameras: FloatArray) -> FloatArray:
    good = cameras[:, 1:5].any(axis=1)
    if not good.all():
        raise text.error("the quaternion is zero", 1 + _CAMERA * int(np.argmin(good)))
    rotations = rotation_from_quaternion(cameras[:, 1:5])
    poses = cameras_from_pose(rotations, np.zeros((len(cameras), 3)))
    poses[:, :, 3] = cameras[:, 5:8]
    return poses


def _pixels(text: NumberText, views: NDArray[np.int64], cameras: FloatArray) -> FloatArray:
    measured = text.values[views[:, None] + np.array([2, 3])].reshape(-1, 2)
    focal, distortion = cameras[:, 0, None], cameras[:, 8, None]
    with np.errstate(all="ignore"):
        pixels = measured * (1 + distortion * np.sum((measured / focal) ** 2, axis=1, keepdims=True))
    good = finite_rows(pixels)
    if not good.all():
        raise text.error("the measurement is too large", int(views[np.argmin(good)]))
    return np.asarray(pixels)


def write_nvm(problem: Problem, path: Path) -> None:
    """Write cameras without distortion: measurements are where such cameras would have seen the points.

    They count from the principal point, so that images that belong to them are without distortion and have
    it in their middle. Without names in the metadata images are ``image_000001`` and so on; without keys the
    observations of each image are numbered from 0; without colours points are black.

    Raises
    ------
    DatasetError
        If a focal length or an aspect ratio is not positive, metadata do not fit the problem, a name is none
        for a line of text, or the file cannot be written.
    """
    require_valid(problem, path)
    require_positive_lengths(as_perspective(problem)[0], path)
    with atomic_files(path) as (stream,):
        stream.write(f"NVM_V3\n\n{problem.num_cameras}\n".encode("ascii"))
        stream.writelines(_camera_chunks(problem, path))
        stream.write(f"\n{problem.num_points}\n".encode("ascii"))
        stream.writelines(_point_chunks(problem, path))
        stream.write(b"\n0\n")


def _camera_chunks(problem: Problem, path: Path) -> Iterator[bytes]:
    names = image_names(problem, path)
    for name in names:
        fault = fault_of_image_name(name)
        if fault is not None or name.startswith("#"):
            raise DatasetError(
                path, f"image name {name!r} {fault or 'must not begin with #, as comments do'}"
            )
    quaternions = quaternion_from_rotation(np.swapaxes(problem.rotations, 1, 2))
    focal = as_perspective(problem)[0][problem.intrinsics_index, 0]
    return format_rows(f"%s\t{' '.join(['%r'] * 8)} 0 0\n", names, focal, *quaternions.T, *problem.centres.T)


def _point_chunks(problem: Problem, path: Path) -> Iterator[bytes]:
    order, counts = by_point(problem)
    keys = observation_keys(problem, KEYS, path)
    heads = Rows(
        "%r %r %r %d %d %d %d",
        (*problem.points.T, *point_colors(problem, (0, 0, 0), path).T, counts),
    )
    views = Rows(" %d %d %r %r", (problem.camera_index, keys, *_measurements(problem).T))
    return format_ragged(heads, views, counts, "\n", order)


def _measurements(problem: Problem) -> FloatArray:
    """(M, 2) pixels from the principal point, as cameras of one focal length without distortion see them."""
    rows, of_view = as_perspective(problem)[0], problem.intrinsics_index[problem.camera_index]
    pinholes = rows[of_view, :PINHOLE]
    seen = to_normalised(undistorted_pixels(problem.pixels, rows, of_view), pinholes)
    return np.asarray(pinholes[:, :1] * seen)


FORMAT = Format(
    "nvm",
    "VisualSFM's NVM_V3, .nvm",
    (".nvm",),
    read_nvm,
    write_nvm,
    undistorts=True,
    lacks=(
        "origin of the world",
        "keypoints without a point",
        "image sizes",
        "masks",
        "rigid frames",
        "shared intrinsics",
        "uncertainties of observations",
    ),
)
