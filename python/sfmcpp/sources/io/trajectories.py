"""Trajectories in the formats of the field: TUM, KITTI, EuRoC, and the truth of a KITTI drive in MATLAB's.

All hold poses world_from_camera (EuRoC: world_from_body), so that no pose is turned round here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from os import PathLike
from pathlib import Path

import numpy as np

from sfmcpp.errors import DatasetError
from sfmcpp.geometry.so3 import nearest_rotation, quaternion_from_rotation, rotation_from_quaternion
from sfmcpp.model import Trajectory
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.checks import PRINTED_ROTATION_TOLERANCE, is_rotation, require_one_of
from sfmcpp.sources.io.atomic import atomic_files
from sfmcpp.sources.io.files import (
    COMPRESSED_SUFFIXES,
    compressed_writer,
    failures_named,
    read_text_bytes,
    require_present,
)
from sfmcpp.sources.io.kitti_mat import read_kitti_mat
from sfmcpp.sources.io.number_text import NumberText
from sfmcpp.sources.io.rows import format_rows

TRAJECTORY_FORMATS = ("tum", "kitti", "euroc", "mat")
WRITABLE_TRAJECTORY_FORMATS = ("tum", "kitti", "euroc")

_NS, _MOST_NS = 1e-9, 2.0**63
_TUM_COLUMNS = 8
_KITTI_COLUMNS = (12, 16, 17)
_EUROC_HEADER = "#timestamp [ns],p_x [m],p_y [m],p_z [m],q_w [],q_x [],q_y [],q_z []\n"


def read_trajectory(path: str | PathLike[str], *, format: str | None = None) -> Trajectory:
    """Read a trajectory.

    Parameters
    ----------
    path : path-like
        ``.mat`` is a KITTI drive's truth, ``.csv`` is EuRoC's ``timestamp [ns], position, quaternion wxyz``.
        Of text files the number of columns tells: 8 is TUM's ``t tx ty tz qx qy qz qw``; 12 or 16 is KITTI's
        rows of the 3×4 or 4×4 matrix, without times; 17 the same after a frame number. Lines that start with
        ``#`` are comments.
    format : str, optional
        One of `TRAJECTORY_FORMATS`, where the name and the columns do not tell.

    Returns
    -------
    Trajectory
        In the file's world; without times (see :attr:`Trajectory.stamped`) for KITTI.

    Raises
    ------
    DatasetError
        If the file cannot be read, is in no known format, a rotation is none, or times or numbers of frames
        do not increase; it names the line.
    InvalidArgument
        If `format` is unknown.
    """
    source = Path(path)
    if format is not None:
        require_one_of("format", format, TRAJECTORY_FORMATS)
    with failures_named(source):
        require_present(source)
        return _reader(source, format)(source)


def write_trajectory(trajectory: Trajectory, path: str | PathLike[str], *, format: str = "tum") -> None:
    """Write a trajectory; the file appears complete or not at all, and reads back the same.

    EuRoC's times are whole nanoseconds: they read back to within one, or what a float64 resolves.

    Parameters
    ----------
    trajectory : Trajectory
        What to write.
    path : path-like
        Where to; compressed if the name ends in ``.gz``, ``.bz2`` or ``.xz``.
    format : str
        One of `WRITABLE_TRAJECTORY_FORMATS`.

    Raises
    ------
    DatasetError
        If the file cannot be written, or the format wants times that `trajectory` does not have, or cannot
        hold them.
    InvalidArgument
        If `format` is unknown.
    """
    require_one_of("format", format, WRITABLE_TRAJECTORY_FORMATS)
    target = Path(path)
    if format != "kitti" and not trajectory.stamped:
        raise DatasetError(target, f"the trajectory has no times: format {format} needs them, kitti does not")
    if format == "euroc":
        _require_whole_ns(trajectory.t_s, target)
    with atomic_files(target) as (stream,), compressed_writer(stream, target) as writer:
        writer.writelines(_ROWS[format](trajectory))


def _require_whole_ns(t_s: FloatArray, path: Path) -> None:
    """Refuse times that whole nanoseconds do not tell apart, or that 64 bits do not hold."""
    ns = np.round(t_s / _NS)
    good = (np.abs(ns) < _MOST_NS) & (np.diff(ns, prepend=-np.inf) > 0)
    if not good.all():
        worst = int(np.argmin(good))
        rule = "must be whole nanoseconds in 64 bits, each more than the one before"
        raise DatasetError(path, f"t_s[{worst}] is {t_s[worst]:.15g} s: {rule}")


def _reader(path: Path, format: str | None) -> Callable[[Path], Trajectory]:
    if format is None:
        suffixes = [suffix for suffix in path.suffixes if suffix not in COMPRESSED_SUFFIXES]
        format = {".mat": "mat", ".csv": "euroc"}.get(suffixes[-1].lower() if suffixes else "")
    readers = {"mat": _read_mat, "euroc": _read_euroc, "tum": _read_tum, "kitti": _read_kitti}
    return _read_text if format is None else readers[format]


def _read_mat(path: Path) -> Trajectory:
    return read_kitti_mat(path).truth


def _read_text(path: Path) -> Trajectory:
    text, table = _table(path)
    if table.shape[1] == _TUM_COLUMNS:
        return _from_tum(text, table)
    if table.shape[1] in _KITTI_COLUMNS:
        return _from_kitti(text, table)
    reason = f"its lines hold {table.shape[1]} numbers: must be 8 (TUM), or 12, 16 or 17 (KITTI)"
    raise text.error(reason, 0)


def _read_tum(path: Path) -> Trajectory:
    text, table = _table(path)
    _require_columns(text, table, table.shape[1] == _TUM_COLUMNS, "8: t tx ty tz qx qy qz qw")
    return _from_tum(text, table)


def _read_kitti(path: Path) -> Trajectory:
    text, table = _table(path)
    _require_columns(text, table, table.shape[1] in _KITTI_COLUMNS, "12, 16, or 17 with a frame number")
    return _from_kitti(text, table)


def _read_euroc(path: Path) -> Trajectory:
    try:
        text, table = _table(path, separator=b",")
    except DatasetError as error:
        form = "its format is taken for EuRoC's, t [ns], position, quaternion wxyz"
        raise DatasetError(path, f"{error.reason} ({form})", error.line) from None
    _require_columns(text, table, table.shape[1] >= 8, "8 or more: t [ns], position, quaternion wxyz")
    return _from_quaternions(text, table[:, 0] * _NS, table[:, 1:4], table[:, 4:8])


def _from_tum(text: NumberText, table: FloatArray) -> Trajectory:
    return _from_quaternions(text, table[:, 0], table[:, 1:4], table[:, (7, 4, 5, 6)])


def _from_quaternions(
    text: NumberText, t_s: FloatArray, centres: FloatArray, quaternions: FloatArray
) -> Trajectory:
    with np.errstate(over="ignore"):  # to infinity, which is no length of one either
        length = np.linalg.norm(quaternions, axis=1)
    rule = f"the quaternion has length {{}}: must be 1 to within {PRINTED_ROTATION_TOLERANCE}"
    _require_rows(text, np.abs(length - 1) <= PRINTED_ROTATION_TOLERANCE, rule, length)
    later = np.concatenate([[True], np.diff(t_s) > 0])
    _require_rows(text, later, "time {} s: must be later than the one before", t_s)
    rotations = rotation_from_quaternion(quaternions)
    return Trajectory(t_s, np.concatenate([rotations, centres[:, :, None]], axis=2))


def _from_kitti(text: NumberText, table: FloatArray) -> Trajectory:
    rows = table
    if table.shape[1] == _KITTI_COLUMNS[-1]:  # poses without times are told apart by their order alone
        _require_rows(text, np.diff(table[:, 0], prepend=-np.inf) > 0, "frame {}: must increase", table[:, 0])
        rows = table[:, 1:]
    if rows.shape[1] == 16:
        last = (rows[:, 12:] == [0, 0, 0, 1]).all(axis=1)
        _require_rows(text, last, "the last row of the matrix must be 0 0 0 1", rows[:, 15])
    poses = rows[:, :12].reshape(-1, 3, 4)
    good = is_rotation(poses[:, :, :3], PRINTED_ROTATION_TOLERANCE)
    _require_rows(text, good, "the first three columns of the matrix are no rotation", rows[:, 0])
    rotations = nearest_rotation(poses[:, :, :3])
    poses = np.concatenate([rotations, poses[:, :, 3:]], axis=2)
    return Trajectory(np.arange(len(poses), dtype=np.float64), poses, stamped=False)


def _table(path: Path, separator: bytes = b" ") -> tuple[NumberText, FloatArray]:
    """Numbers of a text file as a table: every line holds as many as the first one."""
    text = NumberText(path, read_text_bytes(path).replace(separator, b" "), comments=True)
    if not len(text.values):
        raise DatasetError(path, "holds no poses")
    width = int(text.lines.count[0])
    text.require_line_counts(text.lines.count == width, f"{width}, as on the lines before")
    return text, text.values.reshape(-1, width)


def _require_columns(text: NumberText, table: FloatArray, good: bool, wanted: str) -> None:
    if not good:
        raise text.error(f"the line holds {table.shape[1]} numbers: must be {wanted}", 0)


def _require_rows(text: NumberText, good: BoolArray, rule: str, values: FloatArray) -> None:
    if not good.all():
        row = int(np.argmin(good))
        raise text.error(rule.format(f"{values[row]:.15g}"), int(text.lines.first[row]))


def _tum_rows(trajectory: Trajectory) -> Iterator[bytes]:
    w, x, y, z = quaternion_from_rotation(trajectory.rotations).T
    return format_rows("%r %r %r %r %r %r %r %r\n", trajectory.t_s, *trajectory.centres.T, x, y, z, w)


def _kitti_rows(trajectory: Trajectory) -> Iterator[bytes]:
    template = " ".join(["%r"] * 12) + "\n"
    return format_rows(template, *trajectory.poses.reshape(-1, 12).T)


def _euroc_rows(trajectory: Trajectory) -> Iterator[bytes]:
    quaternions = quaternion_from_rotation(trajectory.rotations)
    stamps = np.round(trajectory.t_s / _NS).astype(np.int64)
    yield _EUROC_HEADER.encode("ascii")
    yield from format_rows("%d,%r,%r,%r,%r,%r,%r,%r\n", stamps, *trajectory.centres.T, *quaternions.T)


_ROWS: dict[str, Callable[[Trajectory], Iterator[bytes]]] = {
    "tum": _tum_rows,
    "kitti": _kitti_rows,
    "euroc": _euroc_rows,
}
