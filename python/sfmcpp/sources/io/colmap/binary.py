"""The binary files of a COLMAP model: little-endian, a count of 8 bytes first, then packed records."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import DatasetError
from sfmcpp.sources.io.checks import LARGEST_COUNT, finite_rows
from sfmcpp.sources.io.colmap.camera_models import MODELS, NAME_OF_NUMBER, unsupported
from sfmcpp.sources.io.colmap.tables import NO_POINT, CameraTable, ImageTable, Int64Array, PointTable, Tables
from sfmcpp.sources.io.files import read_bytes
from sfmcpp.sources.io.rows import exclusive_sums

FILES = ("cameras.bin", "images.bin", "points3D.bin")

_COUNT = struct.Struct("<Q")
_CAMERA = struct.Struct("<IiQQ")
_IMAGE = struct.Struct("<I7dI")
_RIG, _SENSOR = struct.Struct("<II"), struct.Struct("<iI")
_KEYPOINT = np.dtype([("pixel", "<f8", 2), ("point", "<i8")])
_POINT = np.dtype(
    [("id", "<i8"), ("position", "<f8", 3), ("color", "u1", 3), ("error", "<f8"), ("track_count", "<u8")]
)
_TRACK = np.dtype([("image", "<u4"), ("keypoint", "<u4")])


class _Records:
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
        return layout.unpack_from(self.data, self.skip(layout.size))

    def array(self, dtype: np.dtype[Any], count: int) -> NDArray[Any]:
        return np.frombuffer(self.data, dtype, count, self.skip(count * dtype.itemsize))

    def name(self) -> str:
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
        if self.offset != len(self.data):
            raise self.error(f"trailing garbage: {len(self.data) - self.offset} bytes")

    def error(self, reason: str) -> DatasetError:
        return DatasetError(self.path, f"{reason} at byte {self.offset} of {len(self.data)}")


def read_binary(folder: Path) -> Tables:
    """Tables of the three binary files in `folder`."""
    cameras, images, points = (folder / name for name in FILES)
    return Tables(_read_cameras(cameras), _read_images(images), _read_points(points))


def sensors_of_rigs(path: Path) -> Iterator[tuple[int, int]]:
    """Identifier and number of sensors of each rig in a rigs.bin, up to the first with more than one."""
    records = _Records(path, _RIG.size)
    for _ in range(records.count):
        rig, sensors = records.unpack(_RIG)
        yield rig, sensors
        records.skip(sensors * _SENSOR.size)


def binary_files(tables: Tables) -> Iterable[bytes]:
    """Content of the three binary files, in the order of `FILES`."""
    yield _cameras_bytes(tables.cameras)
    yield _images_bytes(tables.images)
    yield _points_bytes(tables.points)


def _read_cameras(path: Path) -> CameraTable:
    records = _Records(path, _CAMERA.size)
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
        params.append(records.array(np.dtype("<f8"), len(MODELS[models[-1]].params)).tolist())
    records.require_end()
    size_array = np.array(sizes, dtype=np.int64).reshape(-1, 2)
    table = CameraTable(
        path, None, np.array(ids, dtype=np.int64), models=models, sizes=size_array, params=params
    )
    finite = [bool(np.isfinite(numbers).all()) for numbers in params]
    table.require(np.array(finite, dtype=np.bool_), "a parameter is not finite")
    return table


def _read_images(path: Path) -> ImageTable:
    records = _Records(path, _IMAGE.size + 1 + _COUNT.size)
    heads, names, keypoints = [], [], [np.empty(0, _KEYPOINT)]
    for _ in range(records.count):
        heads.append(records.unpack(_IMAGE))
        names.append(records.name())
        keypoints.append(records.array(_KEYPOINT, records.unpack(_COUNT)[0]))
    records.require_end()
    head = np.array(heads, dtype=np.float64).reshape(-1, 9)
    joined = np.concatenate(keypoints)
    counts = np.array([len(k) for k in keypoints[1:]], dtype=np.int64)
    images = ImageTable(
        path,
        None,
        head[:, 0].astype(np.int64),
        quaternions=head[:, 1:5],
        translations=head[:, 5:8],
        camera_ids=head[:, 8].astype(np.int64),
        names=names,
        keypoint_counts=counts,
        keypoints=joined["pixel"].copy(),
        keypoint_points=joined["point"].astype(np.int64),
    )
    _require_finite_images(images)
    return images


def _require_finite_images(images: ImageTable) -> None:
    poses = np.concatenate([images.quaternions, images.translations], axis=1)
    images.require(finite_rows(poses), "its pose is not finite")
    image = np.repeat(np.arange(len(images.ids)), images.keypoint_counts)
    good = finite_rows(images.keypoints) & (images.keypoint_points >= NO_POINT)
    if not good.all():
        row = int(np.argmin(good))
        pixel, point = images.keypoints[row], images.keypoint_points[row]
        raise images.error(int(image[row]), f"keypoint {pixel} of point {point} is impossible")


def _read_points(path: Path) -> PointTable:
    records = _Records(path, _POINT.itemsize)
    starts = _point_starts(records)
    records.require_end()
    data = np.frombuffer(records.data, np.uint8)
    heads = data[starts[:, None] + np.arange(_POINT.itemsize)].reshape(-1).view(_POINT)
    counts = heads["track_count"].astype(np.int64)
    is_track = np.ones(len(data), dtype=np.bool_)
    is_track[: _COUNT.size] = False
    is_track[(starts[:, None] + np.arange(_POINT.itemsize)).ravel()] = False
    tracks = data[is_track].view(_TRACK)
    points = PointTable(
        path,
        None,
        heads["id"].astype(np.int64),
        positions=heads["position"].copy(),
        colors=heads["color"].copy(),
        errors=heads["error"].astype(np.float64),
        track_counts=counts,
        track_images=tracks["image"].astype(np.int64),
        track_keypoints=tracks["keypoint"].astype(np.int64),
    )
    points.require(finite_rows(points.positions), "its position is not finite")
    points.require(np.isfinite(points.errors), "its error is not finite")
    return points


def _point_starts(records: _Records) -> Int64Array:
    """Offset of each record: a chain in which only the one before tells where the next one is."""
    starts = []
    before_count = _POINT.itemsize - _COUNT.size
    for _ in range(records.count):
        starts.append(records.skip(before_count))
        (track_count,) = records.unpack(_COUNT)
        records.skip(track_count * _TRACK.itemsize)
    return np.array(starts, dtype=np.int64)


def _cameras_bytes(cameras: CameraTable) -> bytes:
    parts = [_COUNT.pack(len(cameras.ids))]
    for row, (name, params) in enumerate(zip(cameras.models, cameras.params, strict=True)):
        parts.append(_CAMERA.pack(int(cameras.ids[row]), MODELS[name].number, *cameras.sizes[row].tolist()))
        parts.append(np.array(params, dtype="<f8").tobytes())
    return b"".join(parts)


def _images_bytes(images: ImageTable) -> bytes:
    keypoints = np.empty(len(images.keypoints), dtype=_KEYPOINT)
    keypoints["pixel"], keypoints["point"] = images.keypoints, images.keypoint_points
    parts = [_COUNT.pack(len(images.ids))]
    starts = exclusive_sums(images.keypoint_counts)
    for row, (start, count) in enumerate(zip(starts.tolist(), images.keypoint_counts.tolist(), strict=True)):
        pose = (*images.quaternions[row].tolist(), *images.translations[row].tolist())
        parts.append(_IMAGE.pack(int(images.ids[row]), *pose, int(images.camera_ids[row])))
        parts += [images.names[row].encode("utf-8"), b"\0", _COUNT.pack(count)]
        parts.append(keypoints[start : start + count].tobytes())
    return b"".join(parts)


def _points_bytes(points: PointTable) -> bytes:
    heads = np.empty(len(points.ids), dtype=_POINT)
    heads["id"], heads["position"], heads["color"] = points.ids, points.positions, points.colors
    heads["error"], heads["track_count"] = points.errors, points.track_counts
    tracks = np.empty(len(points.track_images), dtype=_TRACK)
    tracks["image"], tracks["keypoint"] = points.track_images, points.track_keypoints
    head_bytes = _POINT.itemsize
    starts = np.arange(len(heads)) * head_bytes + exclusive_sums(points.track_counts) * _TRACK.itemsize
    data = np.empty(heads.nbytes + tracks.nbytes, dtype=np.uint8)
    is_head = np.zeros(len(data), dtype=np.bool_)
    is_head[(starts[:, None] + np.arange(head_bytes)).ravel()] = True
    data[is_head], data[~is_head] = heads.view(np.uint8), tracks.view(np.uint8)
    return _COUNT.pack(len(heads)) + data.tobytes()
