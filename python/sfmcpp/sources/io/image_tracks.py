"""Tracks of uncalibrated images, from text, MATLAB and NPZ files or the observations of models.

Malaga PARKING-6L has a MATLAB file for each image: ``Image1.mat``, ``Image2.mat`` … Each holds a matrix
``Image`` of six columns. Its first row is the motion since the last image; the others are a point's number,
counted from 1, u and v [px], and three zeros.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.image_tracks import LARGEST_INDEX, ImageTracks, first_beyond_images, image_tracks
from sfmcpp.sources.io import api, npz, track_files
from sfmcpp.sources.io.checks import fault_of_image_name, first_duplicate
from sfmcpp.sources.io.files import (
    COMPRESSED_SUFFIXES,
    failures_named,
    is_folder,
    read_text_bytes,
    require_present,
)
from sfmcpp.sources.io.mat_files import mat_variables, number_array, require_finite
from sfmcpp.sources.io.number_text import NumberText, TokenSet

# Formats whose pixels are counted from the centre of the image, whatever camera model a problem has now.
_CENTRED = ("bal", "bundler", "nvm")
_ARRAYS = ("camera_index", "point_index", "pixels")
_TABLE_SUFFIXES = (".txt", ".csv", ".tsv", ".tracks")
NOT_SEEN = -1.0
_NAMES = (("image", "track", "x", "y"), ("track", "image", "x", "y"))
_HEAD_BYTES = 1 << 16
_VARIABLE, _COLUMNS = "Image", 6
_FILE = re.compile(r"Image(\d+)\.mat")


def read_image_tracks(path: str | PathLike[str]) -> ImageTracks:
    """Read tracks.

    Parameters
    ----------
    path : path-like
        ``….xy``: VGG's matrix, a row for each track, a pair ``x y`` for each image, ``-1 -1`` where it is not
        seen. ``.txt``, ``.csv``, ``.tsv``, ``.tracks``: lines ``image track x y``, see
        :func:`~sfmcpp.sources.io.image_tracks.read_track_table`, or tracks of a calibrated camera, or a BAL
        problem. ``.npz``: arrays ``camera_index``, ``point_index``, ``pixels`` and, optional, ``names``
        and ``image_sizes``; also a problem of this package. A folder with ``Image1.mat``, ``Image2.mat`` …
        as Malaga's, or of a COLMAP model. A file of Bundler or sba.

    Returns
    -------
    ImageTracks
        Images in the order of the file or of their numbers, tracks numbered without gaps.

    Raises
    ------
    DatasetError
        If the file is missing, unreadable, damaged, in no known format, or holds no observations; it names
        file, reason and, of a text, the line.
    """
    source = Path(path)
    with failures_named(source):
        require_present(source)
        tracks = _reader(source)(source)
    if not len(tracks):
        raise DatasetError(source, "holds no observations of tracks")
    return tracks


def _reader(path: Path) -> Callable[[Path], ImageTracks]:
    name = path.name.lower()
    if name.endswith(COMPRESSED_SUFFIXES):
        name = name.rpartition(".")[0]
    if is_folder(path):
        return read_malaga if is_malaga_folder(path) else _read_problem
    if name.endswith(".xy"):
        return read_vgg
    if name.endswith(".npz"):
        return _read_npz
    if name.endswith(_TABLE_SUFFIXES):
        return _reader_of_text(path)
    return _read_problem


def _reader_of_text(path: Path) -> Callable[[Path], ImageTracks]:
    """What a table of numbers is, as its head tells: BAL's and sba's first line has not four numbers."""
    data = read_text_bytes(path)
    if track_files.has_title(data):
        return _read_camera_tracks
    return read_track_table if looks_like_table(data) else _read_problem


def _read_problem(path: Path) -> ImageTracks:
    return _tracks_of_problem(path, api.read(path))


def _tracks_of_problem(path: Path, problem: Problem) -> ImageTracks:
    metadata = problem.metadata
    names = metadata.names(problem.num_cameras)  # those that a model of the same file would have
    centred = problem.camera_model == "bal" or metadata.source_format in _CENTRED
    sizes = metadata.image_sizes
    return _numbered_tracks(
        path, problem.camera_index, problem.point_index, problem.pixels, names, sizes, centred
    )


def _read_npz(path: Path) -> ImageTracks:
    members = npz.read_members(path)
    if npz.METADATA in members:
        return _tracks_of_problem(path, npz.read_npz(path))
    missing = [name for name in _ARRAYS if name not in members]
    if missing:
        raise DatasetError(path, f"lacks the arrays {', '.join(missing)}: tracks are {', '.join(_ARRAYS)}")
    names = members.get("names")
    labels = None if names is None else [str(name) for name in names.ravel()]
    image, track, pixels = (members[name] for name in _ARRAYS)
    return _numbered_tracks(path, image, track, pixels, labels, members.get("image_sizes"))


def _read_camera_tracks(path: Path) -> ImageTracks:
    tracks = track_files.read_tracks(path)
    names = [f"image_{number:06d}" for number in range(len(tracks.t_s))]
    return _numbered_tracks(path, tracks.frame_index, tracks.track_index, tracks.pixels, names)


def _numbered_tracks(
    path: Path,
    image_index: NDArray[Any],
    track_index: NDArray[Any],
    pixels: NDArray[Any],
    names: list[str] | None,
    sizes: NDArray[Any] | None = None,
    centred: bool = False,
) -> ImageTracks:
    """The tracks, numbered without gaps."""
    for name in names or ():
        if (fault := fault_of_image_name(name)) is not None:
            raise DatasetError(path, f"image name {name!r}: {fault}")
    try:
        found = image_tracks(image_index, track_index, pixels, names=names, sizes=sizes, centred=centred)
    except InvalidArgument as error:
        raise DatasetError(path, str(error)) from error
    track = np.unique(found.track_index, return_inverse=True)[1].astype(np.int32)
    return ImageTracks(found.names, found.sizes, found.centres, found.image_index, track, found.pixels)


def read_vgg(path: Path) -> ImageTracks:
    """Read VGG's matrix: a row for each track, a pair ``x y`` for each image, ``-1 -1`` where it is not seen.

    Raises
    ------
    DatasetError
        If a line has not as many numbers as the first, or an odd number of them; it names the line.
    """
    text = NumberText(path, read_text_bytes(path), comments=True)
    if not len(text.values):
        raise DatasetError(path, "holds no tracks")
    count = int(text.lines.count[0])
    if count % 2:
        raise DatasetError(path, f"the line holds {count} numbers: must be pairs", int(text.lines.number[0]))
    text.require_line_counts(text.lines.count == count, f"{count} as in the first line")
    _require_of_images(text, slice(None))
    positions = text.values.reshape(-1, count // 2, 2)
    track, image = np.nonzero((positions != NOT_SEEN).any(axis=2))
    names = [f"image_{number:06d}" for number in range(count // 2)]
    seen = np.unique(track, return_inverse=True)[1]
    return image_tracks(image, seen, positions[track, image], names=names)


def read_track_table(path: Path) -> ImageTracks:
    """Read lines ``image track x y`` or ``track image x y``, the numbers apart by white space or commas.

    A first line with these names, as a comment or not, tells the order. Without it the column with fewer
    different numbers is that of the images. Images and tracks can have any numbers; images are
    named after theirs.

    Raises
    ------
    DatasetError
        If a line has not four numbers, a number of an image or track is no integer from 0 on, or an image
        sees a track twice; it names the line.
    """
    data = read_text_bytes(path)
    order = _column_order(data)
    text = NumberText(path, _without_separators(data), comments=True)
    text.require_line_counts(text.lines.count == len(_NAMES[0]), f"4: {' '.join(order or _NAMES[0])}")
    first, second = (
        text.integers(slice(column, None, 4), "image or track", 0, LARGEST_INDEX) for column in (0, 1)
    )
    swapped = order == _NAMES[1] if order else len(np.unique(first)) > len(np.unique(second))
    images, tracks = (second, first) if swapped else (first, second)
    _require_once(text, images, tracks)
    numbers, image = np.unique(images, return_inverse=True)
    track = np.unique(tracks, return_inverse=True)[1]
    coordinates = np.flatnonzero(np.tile([False, False, True, True], len(images)))
    _require_of_images(text, coordinates)
    pixels = text.values[coordinates].reshape(-1, 2)
    return image_tracks(image, track, pixels, names=[f"image_{number:06d}" for number in numbers])


def looks_like_table(data: bytes) -> bool:
    """Whether a text names the columns of a table of tracks, or its first line has four words."""
    if _column_order(data):
        return True
    for line in data[:_HEAD_BYTES].splitlines():
        words = line.replace(b",", b" ").split()
        if words and not words[0].startswith(b"#"):
            return len(words) == len(_NAMES[0])
    return False


def _first_line(data: bytes) -> bytes:
    return data[:_HEAD_BYTES].partition(b"\n")[0]


def _column_order(data: bytes) -> tuple[str, ...] | None:
    """Names of the columns in the first line, or None if it has none."""
    words = tuple(re.split(r"[\s,#]+", _first_line(data).decode("utf-8", "replace").strip(" \t\r#").lower()))
    return words if words in _NAMES else None


def _without_separators(data: bytes) -> bytes:
    """The text with white space for commas and, where it is no comment, for the line of names."""
    if _column_order(data):
        length = len(_first_line(data))
        data = b" " * length + data[length:]
    return data.replace(b",", b" ")


def _require_of_images(text: NumberText, tokens: TokenSet) -> None:
    fault = first_beyond_images(text.values[tokens])
    if fault is not None:
        raise text.error(fault[1], text.token_at(tokens, fault[0]))


def _require_once(text: NumberText, images: NDArray[np.int64], tracks: NDArray[np.int64]) -> None:
    duplicate = first_duplicate(images, tracks, int(images.max(initial=0)) + 1)
    if duplicate is not None:
        second = duplicate[1]
        raise text.error(f"image {images[second]} sees track {tracks[second]} twice", 4 * second)


def is_malaga_folder(folder: Path) -> bool:
    """Whether a folder holds such files."""
    return any(_FILE.fullmatch(entry.name) for entry in folder.iterdir())


def read_malaga(folder: Path) -> ImageTracks:
    """Read all images of a folder in the order of their numbers.

    Raises
    ------
    DatasetError
        If a file is no MATLAB file, lacks the matrix, or a point's number is no positive integer or stands
        there twice.
    """
    matches = [match for match in map(_FILE.fullmatch, sorted(e.name for e in folder.iterdir())) if match]
    files = sorted(matches, key=lambda match: (int(match[1]), match[0]))
    rows = [_malaga_rows(folder / match[0]) for match in files]
    joined = np.concatenate(rows)
    image = np.repeat(np.arange(len(rows)), [len(row) for row in rows])
    track = np.unique(joined[:, 0], return_inverse=True)[1]
    try:
        return image_tracks(image, track, joined[:, 1:], names=[match[0] for match in files])
    except InvalidArgument as error:
        raise DatasetError(folder, str(error)) from error


def _malaga_rows(path: Path) -> FloatArray:
    """(m, 3) number of the point, u, v."""
    value = mat_variables(path, [_VARIABLE])[_VARIABLE]
    matrix = number_array(path, _VARIABLE, value, 2, f"(rows, {_COLUMNS})")
    require_finite(path, _VARIABLE, matrix)
    if matrix.shape[1] != _COLUMNS:
        raise DatasetError(path, f"{_VARIABLE} has shape {matrix.shape}: must be (rows, {_COLUMNS})")
    rows = matrix[1:, :3]
    good = (rows[:, 0] >= 1) & (rows[:, 0] <= LARGEST_INDEX) & (rows[:, 0] == np.floor(rows[:, 0]))
    if not good.all():
        worst = int(np.argmin(good))
        raise DatasetError(
            path, f"{_VARIABLE}[{worst + 1}, 0] is {rows[worst, 0]}: must be a point's number from 1"
        )
    return rows
