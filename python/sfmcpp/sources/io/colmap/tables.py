"""The three tables of a COLMAP model as arrays, whatever the files look like."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import DatasetError
from sfmcpp.model.arrays import FloatArray

Int64Array = NDArray[np.int64]
NO_POINT = -1
LARGEST_ID = 2**32 - 2
LARGEST_POINT_ID = 2**53


@dataclass
class Table:
    """Rows with identifiers; `lines` says on which line of `path` each row starts, None if it is binary."""

    path: Path
    lines: Int64Array | None
    ids: Int64Array

    def error(self, row: int, reason: str) -> DatasetError:
        """Make a DatasetError at the line of that row; for binary files the message names the row."""
        if self.lines is None:
            return DatasetError(self.path, f"entry {row} (id {self.ids[row]}): {reason}")
        return DatasetError(self.path, reason, int(self.lines[row]))

    def require(self, good: NDArray[np.bool_], reason: str) -> None:
        """Raise `reason` at the first row that is not good."""
        if not good.all():
            raise self.error(int(np.argmin(good)), reason)

    def require_unique_ids(self, highest: int) -> None:
        """Raise a DatasetError if an identifier occurs twice or is out of range."""
        self.require((self.ids >= 0) & (self.ids <= highest), f"its id must be from 0 to {highest}")
        if (self.ids[1:] > self.ids[:-1]).all():
            return
        order = np.argsort(self.ids, kind="stable")
        repeated = np.flatnonzero(np.diff(self.ids[order]) == 0)
        if len(repeated):
            row = int(order[repeated[0] + 1])
            raise self.error(row, f"id {self.ids[row]} is used twice")

    def rows_of(self, wanted: Int64Array) -> Int64Array:
        """Row of each wanted identifier, -1 where there is none."""
        if not len(self.ids):
            return np.full(len(wanted), -1)
        first, last = int(self.ids[0]), int(self.ids[-1])
        if last - first == len(self.ids) - 1 and (np.diff(self.ids) == 1).all():
            return np.where((wanted >= first) & (wanted <= last), wanted - first, -1)
        order = np.argsort(self.ids)
        place = np.searchsorted(self.ids, wanted, sorter=order)
        rows = order[np.minimum(place, len(order) - 1)]
        return np.where(self.ids[rows] == wanted, rows, -1)


@dataclass
class CameraTable(Table):
    """Cameras in COLMAP's sense, that is, intrinsics: model name, image size [px] and parameters of each."""

    models: list[str]
    sizes: Int64Array
    params: list[list[float]]


@dataclass
class ImageTable(Table):
    """Poses camera_from_world (quaternion wxyz, translation), and the keypoints of all images in one row."""

    quaternions: FloatArray
    translations: FloatArray
    camera_ids: Int64Array
    names: list[str]
    keypoint_counts: Int64Array
    keypoints: FloatArray
    keypoint_points: Int64Array


@dataclass
class PointTable(Table):
    """Points, their colours and errors [px], and the tracks of all points in one row."""

    positions: FloatArray
    colors: NDArray[np.uint8]
    errors: FloatArray
    track_counts: Int64Array
    track_images: Int64Array
    track_keypoints: Int64Array


@dataclass
class Tables:
    """A whole model."""

    cameras: CameraTable
    images: ImageTable
    points: PointTable
