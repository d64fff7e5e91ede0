"""The binary files of a COLMAP model: little-endian, a count of 8 bytes first, then packed records."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp import _core
from sfmcpp.errors import DatasetError
from sfmcpp.sources.io.checks import LARGEST_COUNT, finite_rows
from sfmcpp.sources.io.colmap.camera_models import NAME_OF_NUMBER, READ_MODELS, unsupported
from sfmcpp.sources.io.colmap.tables import NO_POINT, CameraTable, ImageTable, PointTable, Tables
from sfmcpp.sources.io.files import read_bytes
from sfmcpp.sources.io.rows import exclusive_sums

FILES = ("cameras.bin", "images.bin", "points3D.bin")

_COUNT = struct.Struct("<Q")
_CAMERA = struct.Struct("<IiQQ")
_IMAGE = struct.Struct("<I7dI")
_KEYPOINT = np.dtype([("pixel", "<f8", 2), ("point", "<i8")])
_POINT = np.dtype(
    [("id", "<i8"), ("position", "<f8", 3), ("color", "u1", 3), ("error", "<f8"), ("track_count", "<u8")]
)
_POINTS_AT_ONCE = 1 << 16
_TRACK = np.dtype([("image", "<u4"), ("keypoint", "<u4")])


class Records:
    """A cursor over the records of one file that never reads past its end."""

    def __init__(self, path: Path, smallest_record: int) -> None:
        self.path = path
        self.data = read_bytes(path)
        self.offset = 0
        (self.count,) = self.unpack(_COUNT)
        if self.count * smallest_record > len(self.data) - _COUNT.size:
            reason = f"truncated, or no COLMAP file: {len(self.data)} bytes cannot hold {self.count} entries"
            raise DatasetError(path, reason)

    def unpack(self, layout: struct.Struct) -> tuple[Any, ...]:
        """The next numbers."""
        return layout.unpack_from(self.data, self.skip(layout.size))

    def array(self, dtype: np.dtype[Any], count: int) -> NDArray[Any]:
        """The next `count` of a type."""
        return np.frombuffer(self.data, dtype, count, self.skip(count * dtype.itemsize))

    def ragged(self, head: np.dtype[Any], item: np.dtype[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
        """Heads of all records, each ending with a count, and the items that follow them."""
        sizes = head.itemsize, item.itemsize
        heads, items, self.offset = _core.split_records(self.data, self.offset, self.count, *sizes)
        if len(heads) < self.count * head.itemsize:
            raise self.error("truncated: a record does not fit")
        return heads.view(head), items.view(item)

    def name(self) -> str:
        """Text up to a zero."""
        end = self.data.find(b"\0", self.offset)
        if end < 0:
            raise self.error("truncated: an image name has no end")
        raw = self.data[self.offset : end]
        self.offset = end + 1
        try:
            return raw.decode("utf-8")
        except UnicodeDecodeError as error:
            raise self.error(f"an image name is not UTF-8 ({error.reason})") from error

    def skip(self, size: int) -> int:
        """Move past `size` bytes; return where they start."""
        start = self.offset
        if size > len(self.data) - start:
            raise self.error(f"truncated: {size} bytes wanted")
        self.offset = start + size
        return start

    def require_end(self) -> None:
        """Refuse what is left over."""
        if self.offset != len(self.data):
            raise self.error(f"trailing garbage: {len(self.data) - self.offset} bytes")

    def error(self, reason: str) -> DatasetError:
        """Make a DatasetError at the present byte."""
        return DatasetError(self.path, f"{reason} at byte {self.offset} of {len(self.data)}")


def read_binary(folder: Path) -> Tables:
    """Tables of the three binary files in `folder`."""
    cameras, images, points = (folder / name for name in FILES)
    return Tables(_read_cameras(cameras), _read_images(images), _read_points(points))


def binary_files(tables: Tables) -> Iterable[Iterable[bytes]]:
    """Content of the three binary files, in the order of `FILES`, each in pieces."""
    yield _cameras_bytes(tables.cameras)
    yield _images_bytes(tables.images)
    yield _points_bytes(tables.points)


def _read_cameras(path: Path) -> CameraTable:
    records = Records(path, _CAMERA.size)
    ids, models, sizes, params = [], [], [], []
    for _ in range(records.count):
        camera_id, number, width, height = records.unpack(_CAMERA)
        if number not in NAME_OF_NUMBER:
            raise DatasetError(path, f"camera {camera_id}: {unsupported(number)}")
        if max(width, height) > LARGEST_COUNT:
            raise DatasetError(path, f"camera {camera_id}: image size {width}x{height} is impossible")
        ids.append(camera_id)
        models.append(NAME_OF_NUMBER[number])
        sizes.append((width, height))
        params.append(records.array(np.dtype("<f8"), len(READ_MODELS[models[-1]].params)).tolist())
    records.require_end()
    size_array = np.array(sizes, dtype=np.int64).reshape(-1, 2)
    table = CameraTable(
        path, None, np.array(ids, dtype=np.int64), models=models, sizes=size_array, params=params
    )
    finite = [bool(np.isfinite(numbers).all()) for numbers in params]
    table.require(np.array(finite, dtype=np.bool_), "a parameter is not finite")
    return table


def _read_images(path: Path) -> ImageTable:
    records = Records(path, _IMAGE.size + 1 + _COUNT.size)
    heads, names, keypoints = [], [], []
    for _ in range(records.count):
        heads.append(records.unpack(_IMAGE))
        names.append(records.name())
        keypoints.append(records.array(_KEYPOINT, records.unpack(_COUNT)[0]))
    records.require_end()
    head = np.array(heads, dtype=np.float64).reshape(-1, 9)
    counts = np.array([len(part) for part in keypoints], dtype=np.int64)
    pixels, keypoint_points = np.empty((counts.sum(), 2)), np.empty(counts.sum(), dtype=np.int64)
    for end, part in zip(np.cumsum(counts).tolist(), keypoints, strict=True):
        pixels[end - len(part) : end] = part["pixel"]
        keypoint_points[end - len(part) : end] = part["point"]
    images = ImageTable(
        path,
        None,
        head[:, 0].astype(np.int64),
        quaternions=head[:, 1:5],
        translations=head[:, 5:8],
        camera_ids=head[:, 8].astype(np.int64),
        names=names,
        keypoint_counts=counts,
        keypoints=pixels,
        keypoint_points=keypoint_points,
    )
    _require_finite_images(images)
    return images


def _require_finite_images(images: ImageTable) -> None:
    poses = np.concatenate([images.quaternions, images.translations], axis=1)
    images.require(finite_rows(poses), "its pose is not finite")
    good = finite_rows(images.keypoints) & (images.keypoint_points >= NO_POINT)
    if not good.all():
        row = int(np.argmin(good))
        image = np.repeat(np.arange(len(images.ids)), images.keypoint_counts)
        pixel, point = images.keypoints[row], images.keypoint_points[row]
        raise images.error(int(image[row]), f"keypoint {pixel} of point {point} is impossible")


def _read_points(path: Path) -> PointTable:
    records = Records(path, _POINT.itemsize)
    heads, tracks = records.ragged(_POINT, _TRACK)
    records.require_end()
    points = PointTable(
        path,
        None,
        heads["id"].astype(np.int64),
        positions=heads["position"].copy(),
        colors=heads["color"].copy(),
        errors=heads["error"].astype(np.float64),
        track_counts=heads["track_count"].astype(np.int64),
        track_images=tracks["image"].astype(np.int64),
        track_keypoints=tracks["keypoint"].astype(np.int64),
    )
    points.require(finite_rows(points.positions), "its position is not finite")
    points.require(np.isfinite(points.errors), "its error is not finite")
    return points


def _cameras_bytes(cameras: CameraTable) -> Iterator[bytes]:
    yield _COUNT.pack(len(cameras.ids))
    for row, (name, params) in enumerate(zip(cameras.models, cameras.params, strict=True)):
        yield _CAMERA.pack(int(cameras.ids[row]), READ_MODELS[name].number, *cameras.sizes[row].tolist())
        yield np.array(params, dtype="<f8").tobytes()


def _images_bytes(images: ImageTable) -> Iterator[bytes]:
    yield _COUNT.pack(len(images.ids))
    starts = exclusive_sums(images.keypoint_counts)
    for row, (start, count) in enumerate(zip(starts.tolist(), images.keypoint_counts.tolist(), strict=True)):
        pose = (*images.quaternions[row].tolist(), *images.translations[row].tolist())
        yield _IMAGE.pack(int(images.ids[row]), *pose, int(images.camera_ids[row]))
        yield images.names[row].encode("utf-8") + b"\0" + _COUNT.pack(count)
        keypoints = np.empty(count, dtype=_KEYPOINT)
        keypoints["pixel"] = images.keypoints[start : start + count]
        keypoints["point"] = images.keypoint_points[start : start + count]
        yield keypoints.tobytes()


def _points_bytes(points: PointTable) -> Iterator[bytes]:
    yield _COUNT.pack(len(points.ids))
    ends = np.cumsum(points.track_counts)
    for begin in range(0, len(ends), _POINTS_AT_ONCE):
        some = slice(begin, begin + _POINTS_AT_ONCE)
        items = slice(int(ends[begin] - points.track_counts[begin]), int(ends[some][-1]))
        heads = np.empty(len(ends[some]), dtype=_POINT)
        heads["id"], heads["position"], heads["color"] = (
            points.ids[some],
            points.positions[some],
            points.colors[some],
        )
        heads["error"], heads["track_count"] = points.errors[some], points.track_counts[some]
        tracks = np.empty(items.stop - items.start, dtype=_TRACK)
        tracks["image"], tracks["keypoint"] = points.track_images[items], points.track_keypoints[items]
        yield _core.join_records(
            heads.view(np.uint8), tracks.view(np.uint8), _POINT.itemsize, _TRACK.itemsize
        ).tobytes()
