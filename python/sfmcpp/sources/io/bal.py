"""Bundle Adjustment in the Large (Agarwal, Snavely, Seitz, Szeliski 2010), plain or compressed.

Header ``cameras points observations``; a line ``camera point u v`` for each observation; then nine
numbers a camera (angle-axis and translation of camera_from_world, f, k1, k2) and three a point. The
camera looks along -z, pixels have y up and their origin at the principal point.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sfmcpp.ba.ranks import Ranks
from sfmcpp.geometry.so3 import angle_axis_from_rotation, rotation_from_angle_axis
from sfmcpp.model import Metadata, Problem
from sfmcpp.model.arrays import FloatArray, IndexArray
from sfmcpp.sources.io.atomic import atomic_files
from sfmcpp.sources.io.checks import LARGEST_COUNT, finite_rows, first_duplicate, require_valid
from sfmcpp.sources.io.files import COMPRESSED_SUFFIXES, compressed_writer, largest_content, read_own_bytes
from sfmcpp.sources.io.format import GEOMETRY_ALONE, Format
from sfmcpp.sources.io.intrinsics import as_bal
from sfmcpp.sources.io.number_text import NumberStream, NumberText, OwnNumbers, first_no_integer
from sfmcpp.sources.io.poses import cameras_from_y_up_pose, turned_pixels, y_up_pose_from_cameras
from sfmcpp.sources.io.rows import format_rows
from sfmcpp.sources.io.shares import Share

_ROWS_AT_ONCE = 1 << 17
_HEADER, _OBSERVATION, _CAMERA, _POINT = 3, 4, 9, 3


def read_bal(path: Path) -> Problem:
    """Read a BAL file; camera model ``"bal"``, everything free.

    Raises
    ------
    DatasetError
        Naming the line, if anything is not a finite number, a count or an index is impossible, there are
        more or fewer numbers than the header says, or two lines observe the same point by the same camera.
    """
    numbers = NumberStream(path)
    counts = _read_counts(numbers)
    counts.require_room(numbers)
    camera_index, point_index, pixels, fault = _read_observations(numbers, counts)
    cameras = numbers.table(counts.cameras, _CAMERA)
    points = numbers.table(counts.points, _POINT)
    counts.require_all(numbers)
    if fault is not None:
        raise numbers.error(*fault)
    _require_no_duplicates(numbers, first_duplicate(camera_index, point_index, counts.cameras))
    return _problem(numbers, counts, cameras, points, camera_index, point_index, pixels)


def read_bal_share(path: Path, ranks: Ranks) -> Share | None:
    """Read all cameras of such a file, and the points and observations that begin in a rank's bytes of it.

    What a number is follows from how many are before it, which the ranks tell each other.

    Returns
    -------
    Share or None
        None if the file is compressed, or breaks a rule of :func:`read_bal`, whose errors name the line.
    """
    if path.suffix.lower() in COMPRESSED_SUFFIXES:
        return None
    values = ranks.agreed(lambda: NumberText(path, read_own_bytes(path, ranks.rank, ranks.size)).values)
    beginnings = ranks.everyones((len(values), values[:_HEADER]))
    sizes = [size for size, _ in beginnings]
    header = np.concatenate([head for _, head in beginnings])[:_HEADER]
    if len(header) < _HEADER or first_no_integer(header, "count", 0, LARGEST_COUNT) is not None:
        return None
    counts = _Counts(*header.astype(int).tolist())
    if sum(sizes) != counts.numbers:
        return None
    following = np.concatenate([*(head for _, head in beginnings[ranks.rank + 1 :]), np.empty(0)])
    numbers = OwnNumbers(values, sum(sizes[: ranks.rank]), following)
    behind = _HEADER + _OBSERVATION * counts.observations
    own_cameras = numbers.rows(behind, _CAMERA * counts.cameras, 1)[1]
    cameras = np.concatenate(ranks.everyones(own_cameras)).reshape(-1, _CAMERA)
    row, observed = numbers.rows(_HEADER, counts.observations, _OBSERVATION)
    point, points = numbers.rows(behind + _CAMERA * counts.cameras, counts.points, _POINT)
    if _first_no_index(observed, row, counts) is not None:  # before they become integers
        return None
    own = _problem(NumberStream(path), counts, cameras, points, *_observation_columns(observed))
    return Share.of(own, counts.points, point, row)


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
        stream.writelines(_chunks(problem, intrinsics, pixels))


@dataclass(frozen=True)
class _Counts:
    """Counts in the header."""

    cameras: int
    points: int
    observations: int

    @property
    def numbers(self) -> int:
        return _HEADER + _OBSERVATION * self.observations + _CAMERA * self.cameras + _POINT * self.points

    def require_room(self, numbers: NumberStream) -> None:
        """Refuse counts that the size of the file belies, before anything is allocated by them."""
        if 2 * self.numbers - 1 > largest_content(numbers.path):
            self.require_all(numbers)

    def require_all(self, numbers: NumberStream) -> None:
        """Refuse a file with more or fewer numbers; none of them is left then."""
        present, wanted = numbers.count_all(), self.numbers
        if present != wanted:
            fault = "truncated" if present < wanted else "trailing garbage"
            counts = f"{self.cameras} cameras, {self.points} points, {self.observations} observations"
            reason = f"{fault}: {counts} take {wanted} numbers, the file has {present}"
            raise numbers.error(reason, wanted)


def _read_counts(numbers: NumberStream) -> _Counts:
    names = ("number of cameras", "number of points", "number of observations")
    head = numbers.table(1, _HEADER)
    if numbers.taken < _HEADER:
        raise numbers.error(
            "truncated: the header needs three counts (cameras, points, observations)", _HEADER
        )
    for token, name in enumerate(names):
        fault = first_no_integer(head[:, token], name, 0, LARGEST_COUNT)
        if fault is not None:
            raise numbers.error(f"{fault[1]}; a BAL file begins with three counts", token)
    return _Counts(*head[0].astype(int).tolist())


def _read_observations(
    numbers: NumberStream, counts: _Counts
) -> tuple[IndexArray, IndexArray, FloatArray, tuple[str, int] | None]:
    """Camera and point of each observation, its pixel, and the first index that is none, with its token.

    That one counts only if the file has as many numbers as it should.
    """
    cameras = np.empty(counts.observations, dtype=np.int32)
    points = np.empty(counts.observations, dtype=np.int32)
    pixels = np.empty((counts.observations, 2))
    row, fault = 0, None
    for block in numbers.rows(counts.observations, _OBSERVATION):
        part = slice(row, row + len(block))
        fault = fault or _first_no_index(block, row, counts)
        with np.errstate(invalid="ignore"):
            cameras[part], points[part] = block[:, 0], block[:, 1]
        pixels[part] = turned_pixels(block[:, 2:])
        row += len(block)
    return cameras, points, pixels, fault


def _first_no_index(block: FloatArray, row: int, counts: _Counts) -> tuple[str, int] | None:
    for column, (name, size) in enumerate((("camera index", counts.cameras), ("point index", counts.points))):
        fault = first_no_integer(block[:, column], name, 0, size - 1)
        if fault is not None:
            return fault[1], _HEADER + _OBSERVATION * (row + fault[0]) + column
    return None


def _require_no_duplicates(numbers: NumberStream, duplicate: tuple[int, int] | None) -> None:
    if duplicate is None:
        return
    first, second = (_HEADER + _OBSERVATION * row for row in duplicate)
    raise numbers.error(
        f"observes the same point by the same camera as line {numbers.line_of(first)}", second
    )


def _observation_columns(observed: FloatArray) -> tuple[IndexArray, IndexArray, FloatArray]:
    """Camera, point and pixel of observations, whose indices are in range."""
    cameras, points = observed[:, :2].astype(np.int32).T
    return cameras, points, turned_pixels(observed[:, 2:])


def _problem(
    numbers: NumberStream,
    counts: _Counts,
    cameras: FloatArray,
    points: FloatArray,
    camera_index: IndexArray,
    point_index: IndexArray,
    pixels: FloatArray,
) -> Problem:
    poses = _poses(numbers, cameras, _HEADER + _OBSERVATION * counts.observations)
    return Problem(
        "bal",
        poses,
        cameras[:, 6:].copy(),
        points,
        camera_index,
        point_index,
        pixels,
        metadata=Metadata(source_format="bal"),
    )


def _poses(numbers: NumberStream, cameras: FloatArray, start: int) -> FloatArray:
    with np.errstate(all="ignore"):
        poses = cameras_from_y_up_pose(rotation_from_angle_axis(cameras[:, :3]), cameras[:, 3:6])
    finite = finite_rows(poses)
    if not finite.all():
        row = int(np.argmin(finite))
        raise numbers.error(f"camera {row}: the numbers of its pose are too large", start + _CAMERA * row)
    return poses


def _chunks(problem: Problem, intrinsics: FloatArray, pixels: FloatArray) -> Iterator[bytes]:
    rotations, translations = y_up_pose_from_cameras(problem.cameras)
    vectors = angle_axis_from_rotation(rotations)
    yield f"{problem.num_cameras} {problem.num_points} {problem.num_observations}\n".encode("ascii")
    for begin in range(0, problem.num_observations, _ROWS_AT_ONCE):
        rows = slice(begin, begin + _ROWS_AT_ONCE)
        index = problem.camera_index[rows], problem.point_index[rows]
        yield from format_rows("%d %d %r %r\n", *index, *turned_pixels(pixels[rows]).T)
    yield from format_rows("%r\n", np.concatenate([vectors, translations, intrinsics], axis=1).ravel())
    yield from format_rows("%r\n", problem.points.ravel())


FORMAT = Format(
    "bal",
    "Bundle Adjustment in the Large, plain or compressed",
    (".txt", *(f".txt{suffix}" for suffix in COMPRESSED_SUFFIXES)),
    read_bal,
    write_bal,
    share_reader=read_bal_share,
    lacks=(*GEOMETRY_ALONE, "shared intrinsics", "uncertainties of observations"),
)
