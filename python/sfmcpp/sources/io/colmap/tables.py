"""The three tables of a COLMAP model as arrays, common to text and binary files."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import DatasetError
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sources.io.rows import exclusive_sums, tokens_of_items

Int64Array = NDArray[np.int64]
NO_POINT = -1
LARGEST_ID = 2**32 - 2
# They have 64 bits there; the next ones of a map that grows must have room above them.
LARGEST_POINT_ID = 2**62


@dataclass
class Table:
    """Rows with identifiers; `lines` says on which line of `path` each row starts, None if it is binary.

    Rows are in the order of the file, or `entries` says where in it each is.
    """

    path: Path
    lines: Int64Array | None
    ids: Int64Array
    entries: Int64Array | None = field(default=None, init=False)

    def error(self, row: int, reason: str) -> DatasetError:
        """Make a DatasetError at the line of that row; for binary files the message names the row."""
        if self.lines is None:
            entry = row if self.entries is None else self.entries[row]
            return DatasetError(self.path, f"entry {entry} (id {self.ids[row]}): {reason}")
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
        return rows_of_ids(self.ids, wanted)


def rows_of_ids(ids: Int64Array, wanted: Int64Array) -> Int64Array:
    """Row in `ids`, which are all different, of each wanted one, -1 where there is none."""
    if not len(ids):
        return np.full(len(wanted), -1)
    first, last = int(ids[0]), int(ids[-1])
    if last - first == len(ids) - 1 and (np.diff(ids) == 1).all():
        return np.where((wanted >= first) & (wanted <= last), wanted - first, -1)
    order = np.argsort(ids)
    place = np.searchsorted(ids, wanted, sorter=order)
    rows = order[np.minimum(place, len(order) - 1)]
    return np.where(ids[rows] == wanted, rows, -1)


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

    def by_id(self) -> ImageTable:
        """The same rows in the order of their identifiers."""
        if (np.diff(self.ids) > 0).all():
            return self
        order = np.argsort(self.ids, kind="stable")
        counts = self.keypoint_counts[order]
        rows = tokens_of_items(exclusive_sums(self.keypoint_counts)[order], counts, 1)
        table = replace(
            self,
            lines=None if self.lines is None else self.lines[order],
            ids=self.ids[order],
            quaternions=self.quaternions[order],
            translations=self.translations[order],
            camera_ids=self.camera_ids[order],
            names=[self.names[row] for row in order],
            keypoint_counts=counts,
            keypoints=self.keypoints[rows],
            keypoint_points=self.keypoint_points[rows],
        )
        table.entries = order
        return table


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
