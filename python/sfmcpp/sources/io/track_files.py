"""Tracks of one calibrated camera as text: the intrinsics, then a line for every observation.

::

    # sfmcpp tracks
    # intrinsics: f=718.856 aspect=1.0 cx=607.1928 cy=185.2157 skew=0.0
    t_s,frame,track,u,v
    0.0,0,17,320.25,200.5
    0.0,0,18,111.0,98.75
    0.1,1,,,

Times are in seconds and increase with the frame, ``u, v`` and the intrinsics are in pixels; ``aspect`` and
``skew`` may be left out (1 and 0). Frames are numbered 0, 1, 2 … without gaps; one that sees nothing is a
line with its time and number alone. Lines may come in any order; other lines that start with ``#`` are
comments.
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
from sfmcpp.model.arrays import FloatArray, IndexArray
from sfmcpp.sources.io.atomic import atomic_files
from sfmcpp.sources.io.checks import LARGEST_COUNT, first_duplicate
from sfmcpp.sources.io.files import (
    compressed_writer,
    failures_named,
    read_text_bytes,
    require_present,
)
from sfmcpp.sources.io.number_text import NumberText, number_of
from sfmcpp.sources.io.rows import format_rows

_TITLE = "# sfmcpp tracks\n"
_HEAD_BYTES = 1 << 16
_COLUMNS = "t_s,frame,track,u,v"
_DEFAULTS: dict[str, float | None] = {"f": None, "aspect": 1.0, "cx": None, "cy": None, "skew": 0.0}
_INTRINSICS = re.compile(rb"^#[ \t]*intrinsics:(.*)$", re.MULTILINE)
_COLUMN_LINE = re.compile(rb"^" + rb"[ \t]*,[ \t]*".join(_COLUMNS.encode().split(b",")) + rb"\s*$", re.M)
_CELL = rb"[ \t]*[^,\s]+[ \t]*"
_ROW = rb",".join([_CELL] * 5) + rb"|" + rb",".join([_CELL] * 2) + rb"(?:[ \t]*,){3}[ \t]*"
_NO_ROW = re.compile(rb"^(?![ \t]*(?:#.*)?\r?$)(?!(?:" + _ROW + rb")\r?$).+$", re.MULTILINE)


@dataclass(frozen=True, eq=False)
class CameraTracks:
    """Observations of one calibrated camera over n frames: M observations of tracks.

    Attributes
    ----------
    t_s : (n,) float64
        Time of each frame [s], increasing.
    frame_index, track_index : (M,) int32
        Frame and track of each observation.
    pixels : (M, 2) float64
        Where the frame sees the track [px].
    intrinsics : (5,) float64
        ``(f, aspect, cx, cy, skew)`` of the camera model ``"calibrated"``.
    """

    t_s: FloatArray
    frame_index: IndexArray
    track_index: IndexArray
    pixels: FloatArray
    intrinsics: FloatArray


def read_tracks(path: str | PathLike[str]) -> CameraTracks:
    """Read tracks.

    Parameters
    ----------
    path : path-like
        The file, plain or compressed (``.gz``, ``.bz2``, ``.xz``).

    Returns
    -------
    CameraTracks
        Observations in the order of the file.

    Raises
    ------
    DatasetError
        If the file cannot be read, the intrinsics or the line of column names are missing, a line is none of
        those described above, a frame is missing or has two times, the times do not increase with the frame,
        or a frame sees a track twice; it names the line.
    """
    source = Path(path)
    with failures_named(source):
        require_present(source)
        data = read_text_bytes(source)
    intrinsics = _intrinsics(source, data)
    data = _without_column_names(source, data)
    wrong = _NO_ROW.search(data)
    if wrong is not None:
        rule = f"the line is neither {_COLUMNS} nor t_s,frame,,, for a frame that sees nothing"
        raise DatasetError(source, rule, _line_of_byte(data, wrong.start()))
    return _Rows(NumberText(source, data.replace(b",", b" "), comments=True)).tracks(intrinsics)


def has_title(data: bytes) -> bool:
    """Whether a file starts as :func:`write_tracks` starts one, or has its line of intrinsics."""
    return data.startswith(_TITLE.encode().rstrip()) or _INTRINSICS.search(data[:_HEAD_BYTES]) is not None


def write_tracks(tracks: CameraTracks, path: str | PathLike[str]) -> None:
    """Write tracks; the file appears complete or not at all, and reads back the same.

    Parameters
    ----------
    tracks : CameraTracks
        What to write.
    path : path-like
        Where to; compressed if the name ends in ``.gz``, ``.bz2`` or ``.xz``.

    Raises
    ------
    DatasetError
        If the file cannot be written.
    """
    target = Path(path)
    with atomic_files(target) as (stream,), compressed_writer(stream, target) as writer:
        writer.writelines(_lines(tracks))


def _lines(tracks: CameraTracks) -> Iterator[bytes]:
    named = zip(_DEFAULTS, tracks.intrinsics.tolist(), strict=True)
    intrinsics = " ".join(f"{name}={value!r}" for name, value in named)
    yield f"{_TITLE}# intrinsics: {intrinsics}\n{_COLUMNS}\n".encode("ascii")
    frames = tracks.frame_index
    columns = (tracks.t_s[frames], frames, tracks.track_index, *tracks.pixels.T)
    yield from format_rows("%r,%d,%d,%r,%r\n", *columns)
    blind = np.setdiff1d(np.arange(len(tracks.t_s)), frames)
    yield from format_rows("%r,%d,,,\n", tracks.t_s[blind], blind)


def _intrinsics(path: Path, data: bytes) -> FloatArray:
    found = _INTRINSICS.search(data)
    if found is None:
        wanted = "'# intrinsics: f=… aspect=… cx=… cy=… skew=…'"
        reason = f"lacks the line {wanted} of a tracks file; sensors go into --sensor-file"
        raise DatasetError(path, reason, 1)
    line = _line_of_byte(data, found.start())
    if _INTRINSICS.search(data, found.end()) is not None:
        raise DatasetError(path, "the intrinsics are given twice", line)
    values = dict(_DEFAULTS)
    for word in found[1].decode("utf-8", "replace").split():
        name, value = _named_number(path, line, word)
        values[name] = value
    numbers = [value for value in values.values() if value is not None]
    if len(numbers) < len(values):
        missing = ", ".join(name for name, value in values.items() if value is None)
        raise DatasetError(path, f"the intrinsics lack {missing}", line)
    if not (numbers[0] > 0 and numbers[1] > 0):
        raise DatasetError(path, f"intrinsics f={numbers[0]} aspect={numbers[1]}: must be positive", line)
    return np.array(numbers)


def _named_number(path: Path, line: int, word: str) -> tuple[str, float]:
    name, _, text = word.partition("=")
    value = number_of(text)
    if name not in _DEFAULTS or not np.isfinite(value):
        known = ", ".join(_DEFAULTS)
        raise DatasetError(path, f"intrinsics {word!r}: must be NAME=NUMBER, a name of {known}", line)
    return name, value


def _without_column_names(path: Path, data: bytes) -> bytes:
    """Blank out the line of column names, so that all lines keep their numbers."""
    found = _COLUMN_LINE.search(data)
    if found is None:
        raise DatasetError(path, f"lacks the line of column names {_COLUMNS!r}", 1)
    begin, end = found.start(), found.start() + len(found[0].rstrip())
    return data[:begin] + b" " * (end - begin) + data[end:]


def _line_of_byte(data: bytes, byte: int) -> int:
    return data.count(b"\n", 0, byte) + 1


class _Rows:
    """The numbers of the file: rows of five, and rows of two for frames that see nothing."""

    def __init__(self, text: NumberText) -> None:
        if not len(text.values):
            raise DatasetError(text.path, "holds no frames")
        self._text = text
        self._first = text.lines.first
        self._sees = text.lines.count == 5
        self._times = text.values[self._first]
        self._frames = text.integers(self._first + 1, "frame", 0, LARGEST_COUNT)

    def tracks(self, intrinsics: FloatArray) -> CameraTracks:
        seen = self._first[self._sees]
        tracks = self._text.integers(seen + 2, "track", 0, LARGEST_COUNT)
        frames = self._frames[self._sees]
        self._require_once(frames, tracks)
        pixels = self._text.values[seen[:, None] + [3, 4]]
        t_s = self._frame_times()
        return CameraTracks(t_s, frames.astype(np.int32), tracks.astype(np.int32), pixels, intrinsics)

    def _frame_times(self) -> FloatArray:
        """Time of each frame (n,), where every row of a frame must agree."""
        numbers, row = np.unique(self._frames, return_index=True)
        gap = numbers != np.arange(len(numbers))
        if gap.any():
            missing = int(np.argmax(gap))
            reason = f"frame {missing} is missing: frames are numbered from 0 without gaps"
            raise self._error(f"{reason}, one that sees nothing is 't_s,{missing},,,'", row[missing])
        t_s = self._times[row]
        differs = self._times != t_s[self._frames]
        if differs.any():
            bad = int(np.argmax(differs))
            frame = self._frames[bad]
            raise self._error(f"frame {frame} is at {self._times[bad]} s and at {t_s[frame]} s", bad)
        late = np.flatnonzero(np.diff(t_s) <= 0)
        if len(late):
            frame = int(late[0]) + 1
            reason = f"frame {frame} is at {t_s[frame]} s, the one before at {t_s[frame - 1]} s"
            raise self._error(f"{reason}: times must increase", row[frame])
        return t_s

    def _require_once(self, frames: NDArray[np.int64], tracks: NDArray[np.int64]) -> None:
        duplicate = first_duplicate(frames, tracks, int(frames.max(initial=0)) + 1)
        if duplicate is not None:
            second = duplicate[1]
            reason = f"frame {frames[second]} sees track {tracks[second]} twice"
            raise self._error(reason, np.flatnonzero(self._sees)[second])

    def _error(self, reason: str, row: int) -> DatasetError:
        return self._text.error(reason, int(self._first[row]))
