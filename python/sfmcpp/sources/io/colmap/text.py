"""The text files of a COLMAP model."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from sfmcpp.errors import DatasetError
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sources.io.checks import LARGEST_COUNT
from sfmcpp.sources.io.colmap.camera_models import READ_MODELS, unsupported
from sfmcpp.sources.io.colmap.tables import (
    LARGEST_ID,
    LARGEST_POINT_ID,
    NO_POINT,
    CameraTable,
    ImageTable,
    Int64Array,
    PointTable,
    Tables,
)
from sfmcpp.sources.io.files import read_text_bytes
from sfmcpp.sources.io.number_text import NumberText
from sfmcpp.sources.io.rows import Rows, format_ragged, tokens_of_items

FILES = ("cameras.txt", "images.txt", "points3D.txt")
_IMAGE_NUMBERS, _POINT_NUMBERS = 9, 8
_KEYPOINT, _TRACK = 3, 2


def read_text(folder: Path) -> Tables:
    """Tables of the three text files in `folder`."""
    cameras, images, points = (folder / name for name in FILES)
    return Tables(_read_cameras(cameras), _read_images(images), _read_points(points))


def text_files(tables: Tables) -> Iterable[Iterable[bytes]]:
    """Content of the three text files, in the order of `FILES`, each in pieces."""
    yield [_cameras_text(tables.cameras).encode("utf-8")]
    yield _images_text(tables.images)
    yield _points_text(tables.points)


def _read_cameras(path: Path) -> CameraTable:
    lines = read_lines(path)
    rows = [i for i, line in enumerate(lines) if not is_comment(line)]
    models = []
    for row in rows:
        words = lines[row].split()
        models.append(_model_name(path, words, row + 1))
        lines[row] = b" ".join(words[:1] + words[2:])
    text = NumberText(path, b"\n".join(lines), comments=True)
    widths = np.array([3 + len(READ_MODELS[name].params) for name in models], dtype=np.int64)
    _require_widths(text, widths)
    first = text.lines.first
    sizes = text.integers((first[:, None] + np.array([1, 2])).ravel(), "image size", 0, LARGEST_COUNT)
    return CameraTable(
        path,
        text.lines.number,
        text.integers(first, "camera id", 0, LARGEST_ID),
        models=models,
        sizes=sizes.reshape(-1, 2),
        params=[text.values[f + 3 : f + w].tolist() for f, w in zip(first, widths, strict=True)],
    )


def _model_name(path: Path, words: list[bytes], line: int) -> str:
    if len(words) < 2:
        raise DatasetError(path, "the line must hold id, model, width, height and parameters", line)
    name = words[1][:40].decode("ascii", "backslashreplace")
    if name not in READ_MODELS:
        raise DatasetError(path, unsupported(name), line)
    return name


def _require_widths(text: NumberText, widths: Int64Array) -> None:
    lines = text.lines
    wrong = lines.count != widths
    if wrong.any():
        row = int(np.argmax(wrong))
        reason = f"the line holds {lines.count[row]} numbers, its camera model takes {widths[row]}"
        raise DatasetError(text.path, reason, int(lines.number[row]))


def _read_images(path: Path) -> ImageTable:
    lines = read_lines(path)
    rows = _image_rows(lines)
    heads, keypoints, names = [b""] * len(lines), [b""] * len(lines), []
    for row in rows:
        words = lines[row].split(None, _IMAGE_NUMBERS)
        names.append(_image_name(path, words, row + 1))
        heads[row] = b" ".join(words[:_IMAGE_NUMBERS])
        for second in lines[row + 1 : row + 2]:
            _refuse_image(path, second, row + 2)
            keypoints[row + 1] = second
    head = NumberText(path, b"\n".join(heads))
    table = head.values.reshape(-1, _IMAGE_NUMBERS)
    first = head.lines.first
    counts, pixels, point_ids = _read_keypoints(
        NumberText(path, b"\n".join(keypoints)), np.array(rows, np.int64)
    )
    return ImageTable(
        path,
        head.lines.number,
        head.integers(first, "image id", 0, LARGEST_ID),
        quaternions=table[:, 1:5],
        translations=table[:, 5:8],
        camera_ids=head.integers(first + 8, "camera id", 0, LARGEST_ID),
        names=names,
        keypoint_counts=counts,
        keypoints=pixels,
        keypoint_points=point_ids,
    )


def _image_rows(lines: list[bytes]) -> list[int]:
    """Lines at which images start: each takes two lines, the second of which may be empty."""
    rows, row = [], 0
    while row < len(lines):
        if is_comment(lines[row]):
            row += 1
        else:
            rows.append(row)
            row += 2
    return rows


def _refuse_image(path: Path, keypoints: bytes, line: int) -> None:
    """Refuse the next image where the keypoints of one should be, as in files written by hand."""
    others = keypoints.split(None, _IMAGE_NUMBERS + 1)[_IMAGE_NUMBERS:]
    try:
        [float(word) for word in others[:1]]
    except ValueError:
        rule = "each takes two lines, the second for its keypoints, or empty"
        raise DatasetError(
            path, f"must hold the keypoints of the image before, not an image: {rule}", line
        ) from None


def _image_name(path: Path, words: list[bytes], line: int) -> str:
    if len(words) <= _IMAGE_NUMBERS:
        raise DatasetError(path, "the line must hold id, quaternion, translation, camera id and name", line)
    try:
        return words[_IMAGE_NUMBERS].strip().decode("utf-8")
    except UnicodeDecodeError as error:
        raise DatasetError(path, f"the image name is not UTF-8 ({error.reason})", line) from error


def _read_keypoints(text: NumberText, rows: Int64Array) -> tuple[Int64Array, FloatArray, Int64Array]:
    text.require_line_counts(text.lines.count % _KEYPOINT == 0, "a multiple of 3 (X, Y, POINT3D_ID)")
    counts = np.zeros(len(rows), dtype=np.int64)
    # The line after the image's, both counted from 1, is line `row + 2`.
    counts[np.searchsorted(rows + 2, text.lines.number)] = text.lines.count // _KEYPOINT
    table = text.values.reshape(-1, _KEYPOINT)
    ids = text.integers(slice(2, None, _KEYPOINT), "point id of a keypoint", NO_POINT, LARGEST_POINT_ID)
    return counts, table[:, :2].copy(), ids


def _read_points(path: Path) -> PointTable:
    # COLMAP asks for an empty file where poses are known and points are to be found.
    text = NumberText(path, read_text_bytes(path, may_be_empty=True), comments=True)
    lines = text.lines
    good = (lines.count >= _POINT_NUMBERS) & ((lines.count - _POINT_NUMBERS) % _TRACK == 0)
    text.require_line_counts(good, "8 (id, position, colour, error) and pairs of image id and keypoint")
    counts = (lines.count - _POINT_NUMBERS) // _TRACK
    colors = text.integers((lines.first[:, None] + np.array([4, 5, 6])).ravel(), "colour", 0, 255)
    tracks = tokens_of_items(lines.first + _POINT_NUMBERS, counts, _TRACK)
    return PointTable(
        path,
        lines.number,
        text.integers(lines.first, "point id", 0, LARGEST_POINT_ID),
        positions=text.values[lines.first[:, None] + np.array([1, 2, 3])],
        colors=colors.astype(np.uint8).reshape(-1, 3),
        errors=text.values[lines.first + 7],
        track_counts=counts,
        track_images=text.integers(tracks, "image id", 0, LARGEST_ID),
        track_keypoints=text.integers(tracks + 1, "keypoint", 0, LARGEST_COUNT),
    )


def read_lines(path: Path) -> list[bytes]:
    """The lines of a file."""
    return read_text_bytes(path).split(b"\n")


def is_comment(line: bytes) -> bool:
    """Whether a line is empty or begins with #."""
    return not line.strip() or line.lstrip().startswith(b"#")


def _cameras_text(cameras: CameraTable) -> str:
    text = "# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]\n"
    for row, (model, params) in enumerate(zip(cameras.models, cameras.params, strict=True)):
        width, height = cameras.sizes[row]
        text += f"{cameras.ids[row]} {model} {width} {height} {' '.join(map(repr, params))}\n"
    return text


def _images_text(images: ImageTable) -> Iterator[bytes]:
    yield b"# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then on a line POINTS2D[] as (X Y POINT3D_ID)\n"
    columns = (images.ids, *images.quaternions.T, *images.translations.T, images.camera_ids, images.names)
    heads = Rows("%d" + " %r" * 7 + " %d %s\n", columns)
    items = Rows(" %r %r %d", (*images.keypoints.T, images.keypoint_points))
    yield from format_ragged(heads, items, images.keypoint_counts, "\n")


def _points_text(points: PointTable) -> Iterator[bytes]:
    yield b"# POINT3D_ID X Y Z R G B ERROR TRACK[] as (IMAGE_ID POINT2D_IDX)\n"
    columns = (points.ids, *points.positions.T, *points.colors.T, points.errors)
    heads = Rows("%d %r %r %r %d %d %d %r", columns)
    items = Rows(" %d %d", (points.track_images, points.track_keypoints))
    yield from format_ragged(heads, items, points.track_counts, "\n")
