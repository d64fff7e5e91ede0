"""Tracks as text: VGG's matrix of pairs, and tables with a line for every observation."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import DatasetError
from sfmcpp.model.image_tracks import LARGEST_INDEX, ImageTracks, image_tracks
from sfmcpp.sources.io.files import read_text_bytes
from sfmcpp.sources.io.number_text import NumberText

NOT_SEEN = -1.0

_NAMES = (("image", "track", "x", "y"), ("track", "image", "x", "y"))
_HEAD_BYTES = 1 << 16


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
    order = _named_order(data)
    text = NumberText(path, _numbers_alone(data), comments=True)
    text.require_line_counts(text.lines.count == len(_NAMES[0]), f"4: {' '.join(order or _NAMES[0])}")
    first, second = (
        text.integers(slice(column, None, 4), "image or track", 0, LARGEST_INDEX) for column in (0, 1)
    )
    swapped = order == _NAMES[1] if order else len(np.unique(first)) > len(np.unique(second))
    images, tracks = (second, first) if swapped else (first, second)
    _require_once(text, images, tracks)
    numbers, image = np.unique(images, return_inverse=True)
    track = np.unique(tracks, return_inverse=True)[1]
    pixels = text.values.reshape(-1, 4)[:, 2:]
    return image_tracks(image, track, pixels, names=[f"image_{number:06d}" for number in numbers])


def looks_like_table(data: bytes) -> bool:
    """Whether a text names the columns of a table of tracks, or its first line has four words."""
    if _named_order(data):
        return True
    for line in data[:_HEAD_BYTES].splitlines():
        words = line.replace(b",", b" ").split()
        if words and not words[0].startswith(b"#"):
            return len(words) == len(_NAMES[0])
    return False


def _first_line(data: bytes) -> bytes:
    return data[:_HEAD_BYTES].partition(b"\n")[0]


def _named_order(data: bytes) -> tuple[str, ...] | None:
    """Names of the columns in the first line, or None if it has none."""
    words = tuple(re.split(r"[\s,#]+", _first_line(data).decode("utf-8", "replace").strip(" \t\r#").lower()))
    return words if words in _NAMES else None


def _numbers_alone(data: bytes) -> bytes:
    """The text with white space for commas and, where it is no comment, for the line of names."""
    if _named_order(data):
        length = len(_first_line(data))
        data = b" " * length + data[length:]
    return data.replace(b",", b" ")


def _require_once(text: NumberText, images: NDArray[np.int64], tracks: NDArray[np.int64]) -> None:
    order = np.lexsort((tracks, images))
    same = (np.diff(images[order]) == 0) & (np.diff(tracks[order]) == 0)
    if same.any():
        second = int(order[1:][same].min())
        raise text.error(f"image {images[second]} sees track {tracks[second]} twice", 4 * second)
