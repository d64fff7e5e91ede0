"""The text files of sba's demonstration program (Lourakis & Argyros 2009): cameras, points, calibration.

A line a camera: quaternion wxyz and translation (``x_cam = R X + t``), preceded, if the intrinsics vary,
by ``f cx cy aspect skew``, and by ``k1 k2 p1 p2 k3`` if distortion does. A line a point: ``X Y Z n`` and
n times ``frame x y``, each optionally followed by its covariance (3 or 4 numbers). Lines that start
with ``#`` are comments.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import DatasetError
from sfmcpp.geometry.so3 import quaternion_from_rotation, rotation_from_quaternion
from sfmcpp.model import Metadata, Problem
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import BoolArray, FloatArray, IndexArray
from sfmcpp.model.uncertainty import Uncertainty, first_bad_covariance
from sfmcpp.sources.io.atomic import atomic_files
from sfmcpp.sources.io.checks import LARGEST_COUNT, finite_rows, first_duplicate, require_valid
from sfmcpp.sources.io.files import is_present, is_regular_file, read_text_bytes
from sfmcpp.sources.io.format import GEOMETRY_ALONE, Format
from sfmcpp.sources.io.intrinsics import (
    as_perspective,
    fixed_but,
    perspective_columns,
    perspective_rows,
    require_defaults_except,
)
from sfmcpp.sources.io.number_text import NumberText
from sfmcpp.sources.io.poses import cameras_from_pose, pose_from_cameras
from sfmcpp.sources.io.rows import Rows, by_point, format_ragged, format_rows, tokens_of_items

INTRINSICS = ("f", "cx", "cy", "aspect", "skew")
DISTORTION = ("k1", "k2", "p1", "p2", "k3")
POSE_NUMBERS = 7

_CAMERAS_NAME = re.compile(r"(?P<stem>.*)cams[^/]*\.txt", re.IGNORECASE)
_FREE = {POSE_NUMBERS + 5: ("f", "cx", "cy"), POSE_NUMBERS + 10: ("f", "cx", "cy", "k1", "k2")}
_VIEW_WIDTHS = (3, 6, 7)
_POINT_NUMBERS = 4
_FIRST_LINE_BYTES = 4096


@checked()
def read_sba(
    cameras: str | PathLike[str],
    points: str | PathLike[str],
    calibration: str | PathLike[str] | None = None,
) -> Problem:
    """Read sba's cameras file, points file and, for cameras without intrinsics, calibration file.

    Fixed intrinsics give camera model ``"calibrated"``; intrinsics on each line ``"perspective"`` with
    f, cx, cy free, and k1, k2 too if there is distortion. If all covariances are σ² I they become `sigma_px`,
    else `covariance_px2`.

    Parameters
    ----------
    cameras, points : path-like
        The file of cameras, and that of points with their observations.
    calibration : path-like, optional
        The file of the 3×3 matrix K, for a cameras file without intrinsics.

    Returns
    -------
    Problem
        With a row of intrinsics for each camera, or one for all where they come from `calibration`.

    Raises
    ------
    DatasetError
        Naming the file and the line at fault.
    """
    text = _table(Path(cameras))
    width = _camera_width(text)
    rows = text.values.reshape(-1, width)
    if width == POSE_NUMBERS:
        model, intrinsics, fixed = "calibrated", _calibration(text.path, calibration), None
        intrinsics_index = np.zeros(len(rows), dtype=np.int32)
    else:
        model, intrinsics, fixed = "perspective", _intrinsics(rows), fixed_but(len(rows), *_FREE[width])
        intrinsics_index = np.arange(len(rows), dtype=np.int32)
    tracks = _read_tracks(_table(Path(points)), len(rows))
    return Problem(
        model,
        _poses(text, rows[:, -POSE_NUMBERS:]),
        intrinsics,
        tracks.points,
        tracks.camera_index,
        tracks.point_index,
        tracks.pixels,
        intrinsics_index=intrinsics_index,
        sigma_px=tracks.uncertainty.sigma_px,
        covariance_px2=tracks.uncertainty.covariance_px2,
        fixed_intrinsics=fixed,
        metadata=Metadata(source_format="sba"),
    )


@dataclass(frozen=True)
class _Tracks:
    points: FloatArray
    camera_index: IndexArray
    point_index: IndexArray
    pixels: FloatArray
    uncertainty: Uncertainty


def _table(path: Path) -> NumberText:
    text = NumberText(path, read_text_bytes(path), comments=True)
    if not len(text.values):
        raise DatasetError(path, "holds no numbers, only comments")
    return text


def _camera_width(text: NumberText) -> int:
    widths = (POSE_NUMBERS, *_FREE)
    counts = text.lines.count
    allowed = "7 (pose), 12 (intrinsics, pose) or 17 (intrinsics, distortion, pose)"
    text.require_line_counts(np.isin(counts[:1], widths), allowed)
    text.require_line_counts(counts == counts[0], f"{counts[0]} as on the first line")
    return int(counts[0])


def _intrinsics(rows: FloatArray) -> FloatArray:
    names = (INTRINSICS + DISTORTION)[: rows.shape[1] - POSE_NUMBERS]
    intrinsics = perspective_rows(len(rows))
    intrinsics[:, perspective_columns(*names)] = rows[:, : len(names)]
    return intrinsics


def _poses(text: NumberText, poses: FloatArray) -> FloatArray:
    good = poses[:, :4].any(axis=1)
    if not good.all():
        row = int(np.argmin(good))
        raise DatasetError(text.path, "the quaternion is zero", int(text.lines.number[row]))
    with np.errstate(all="ignore"):
        cameras = cameras_from_pose(rotation_from_quaternion(poses[:, :4]), poses[:, 4:])
    finite = finite_rows(cameras)
    if not finite.all():
        line = int(text.lines.number[int(np.argmin(finite))])
        raise DatasetError(text.path, "the numbers of the pose are too large", line)
    return cameras


def _calibration(cameras: Path, given: str | PathLike[str] | None) -> FloatArray:
    path = _find_calibration(cameras) if given is None else Path(given)
    text = _table(path)
    text.require_line_counts(text.lines.count == 3, "3")
    if len(text.values) != 9:
        raise text.error(f"a calibration matrix has 3 lines, not {len(text.lines.count)}", 9)
    matrix = text.values.reshape(3, 3)
    if (matrix[np.tril_indices(3, -1)] != 0).any() or matrix[2, 2] != 1:
        raise text.error("the calibration matrix must be [[f, skew, cx], [0, f*aspect, cy], [0, 0, 1]]", 0)
    (f, skew, cx), (_, fy, cy), _ = matrix.tolist()
    with np.errstate(all="ignore"):
        aspect = float(np.float64(fy) / f)
    if not np.isfinite(aspect):
        raise text.error(f"aspect ratio {fy} / {f} is not finite", 0)
    return np.array([[f, aspect, cx, cy, skew]])


def _find_calibration(cameras: Path) -> Path:
    for path in (calibration_path(cameras), shared_calibration_path(cameras)):
        if is_present(path):
            return path
    names = f"{calibration_path(cameras).name!r} or {shared_calibration_path(cameras).name!r}"
    raise DatasetError(cameras, f"holds poses alone, and there is no calibration file {names} beside it")


def _read_tracks(text: NumberText, num_cameras: int) -> _Tracks:
    counts, width = _view_counts(text)
    views = tokens_of_items(text.lines.first + _POINT_NUMBERS, counts, width)
    camera_index = text.integers(views, "frame", 0, num_cameras - 1)
    point_index = np.repeat(np.arange(len(counts)), counts)
    duplicate = first_duplicate(camera_index, point_index, num_cameras)
    if duplicate is not None:
        row = duplicate[1]
        raise text.error(f"frame {camera_index[row]} observes this point twice", int(views[row]))
    return _Tracks(
        text.values[text.lines.first[:, None] + np.arange(3)],
        camera_index.astype(np.int32),
        point_index.astype(np.int32),
        text.values[views[:, None] + np.array([1, 2])],
        Uncertainty() if width == _VIEW_WIDTHS[0] else _uncertainty(text, views, width),
    )


def _view_counts(text: NumberText) -> tuple[NDArray[np.int64], int]:
    """Count the views of each point, and how many numbers one view takes in this file."""
    lines = text.lines
    text.require_line_counts(lines.count >= _POINT_NUMBERS, "at least 4 (X Y Z and the number of frames)")
    counts = text.integers(lines.first + 3, "number of frames", 0, LARGEST_COUNT)
    fits = {width: lines.count == _POINT_NUMBERS + width * counts for width in _VIEW_WIDTHS}
    width = max(_VIEW_WIDTHS, key=lambda w: _count_leading(fits[w]))
    text.require_line_counts(fits[width], f"4 + {width} for each of the frames announced by the fourth")
    return counts, width


def _count_leading(good: BoolArray) -> int:
    """How many are true before the first that is false."""
    return len(good) if good.all() else int(np.argmin(good))


def _uncertainty(text: NumberText, views: NDArray[np.int64], width: int) -> Uncertainty:
    """Uncertainties from the covariances of observations; three numbers are the upper triangle."""
    places = [3, 4, 4, 5] if width == _VIEW_WIDTHS[1] else [3, 4, 5, 6]
    covariances = text.values[views[:, None] + np.array(places)].reshape(-1, 2, 2)
    bad = first_bad_covariance(covariances)
    if bad is not None:
        row, rule = bad
        raise text.error(f"covariance {covariances[row].tolist()} must be {rule}", int(views[row]))
    return Uncertainty.of_covariances(covariances)


def _read_with_points_beside(cameras: Path) -> Problem:
    points = points_path(cameras)
    if is_regular_file(cameras) and not is_present(points):
        raise DatasetError(cameras, f"the points file {points.name!r} is not beside it")
    return read_sba(cameras, points)


def _is_sba(path: Path) -> bool:
    return is_cameras_name(path) and not _starts_like_bal(path)


def _starts_like_bal(path: Path) -> bool:
    """Whether the first line has three words: BAL's has, a line of a cameras file has more."""
    if not is_regular_file(path):
        return False
    with path.open("rb") as file:
        words = file.readline(_FIRST_LINE_BYTES).split()
    return len(words) == 3 and not words[0].startswith(b"#")


def write_sba(problem: Problem, path: Path) -> None:
    """Write ``…cams….txt``, ``…pts.txt`` beside it, and ``…calib.txt`` if all cameras share fixed intrinsics.

    Standard deviations are written as covariances σ² I, covariances by their upper triangle; masks are not
    kept.

    Raises
    ------
    DatasetError
        If there are no cameras or no points, the camera model has k4 or k5, or a file cannot be written.
    """
    require_valid(problem, path)
    if not problem.num_cameras or not problem.num_points:
        raise DatasetError(path, "sba's files cannot hold a problem without cameras or without points")
    values, fixed = as_perspective(problem)
    require_defaults_except(values, INTRINSICS + DISTORTION, "sba's files", path)
    values, fixed = values[problem.intrinsics_index], fixed[problem.intrinsics_index]
    distortion = perspective_columns(*DISTORTION)
    if problem.camera_model == "calibrated" and (values == values[0]).all():
        texts = {path: _cameras_text(problem, values, ())}
        texts[calibration_path(path)] = _calibration_text(values[0])
    elif values[:, distortion].any() or not fixed[:, distortion].all():
        texts = {path: _cameras_text(problem, values, INTRINSICS + DISTORTION)}
    else:
        texts = {path: _cameras_text(problem, values, INTRINSICS)}
    texts[points_path(path)] = _points_text(problem)
    with atomic_files(*texts) as files:
        for file, text in zip(files, texts.values(), strict=True):
            file.writelines(text)


def _cameras_text(problem: Problem, values: FloatArray, names: tuple[str, ...]) -> Iterator[bytes]:
    rotations, translations = pose_from_cameras(problem.cameras)
    quaternions = quaternion_from_rotation(rotations)
    table = np.concatenate([values[:, perspective_columns(*names)], quaternions, translations], axis=1)
    head = " ".join((*names, "qw qx qy qz tx ty tz"))
    yield f"# {head}\n".encode("ascii")
    yield from format_rows(" ".join(["%r"] * table.shape[1]) + "\n", *table.T)


def _calibration_text(values: FloatArray) -> Iterator[bytes]:
    f, cx, cy, aspect, skew = values[perspective_columns(*INTRINSICS)].tolist()
    yield f"{f!r} {skew!r} {cx!r}\n0.0 {f * aspect!r} {cy!r}\n0.0 0.0 1.0\n".encode("ascii")


def _points_text(problem: Problem) -> Iterator[bytes]:
    order, counts = by_point(problem)
    template, columns = " %d %r %r", [problem.camera_index, *problem.pixels.T]
    if problem.sigma_px is not None:
        template, columns = template + " %r 0 %r", [*columns, *[problem.sigma_px**2] * 2]
    if problem.covariance_px2 is not None:
        upper = problem.covariance_px2.reshape(-1, 4)[:, [0, 1, 3]]
        template, columns = template + " %r %r %r", [*columns, *upper.T]
    yield b"# X Y Z  frames  frame x y ...\n"
    heads = Rows("%r %r %r  %d ", (*problem.points.T, counts))
    yield from format_ragged(heads, Rows(template, columns), counts, "\n", order)


def is_cameras_name(path: Path) -> bool:
    """Whether a name is that of a cameras file: ``…cams….txt``."""
    return _CAMERAS_NAME.fullmatch(path.name) is not None


def points_path(cameras: Path) -> Path:
    """``7pts.txt`` beside ``7cams.txt`` or ``7camsvarK.txt``."""
    return cameras.with_name(f"{_stem(cameras)}pts.txt")


def calibration_path(cameras: Path) -> Path:
    """``7calib.txt`` beside ``7cams.txt``."""
    return cameras.with_name(f"{_stem(cameras)}calib.txt")


def shared_calibration_path(cameras: Path) -> Path:
    """``calib.txt``, which the cameras files of a folder may share."""
    return cameras.with_name("calib.txt")


def _stem(cameras: Path) -> str:
    match = _CAMERAS_NAME.fullmatch(cameras.name)
    return match["stem"] if match else f"{cameras.stem}_"


FORMAT = Format(
    "sba",
    "sba's demonstration format: …cams….txt with …pts.txt and calib.txt beside it",
    ("cams*.txt",),
    _read_with_points_beside,
    write_sba,
    _is_sba,
    lacks=(*GEOMETRY_ALONE, "shared intrinsics"),
)
