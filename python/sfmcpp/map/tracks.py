"""Observations in both directions: the point of a keypoint, and the keypoints of a point as a linked list."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sfmcpp.map.table import Table
from sfmcpp.model.arrays import BoolArray, IndexArray

Rows = NDArray[np.intp]
NONE = -1


class Tracks:
    """Points of keypoints, and keypoints of points.

    Each point knows its first and its last keypoint, each keypoint the next one of its point: what is asked
    of some points costs what they have, however large the map is.
    """

    def __init__(self) -> None:
        self._keypoints = Table(point=(np.int32, (), NONE), next=(np.intp, (), NONE))
        self._points = Table(first=(np.intp, (), NONE), last=(np.intp, (), NONE))

    @property
    def point(self) -> IndexArray:
        """(K,) point that each keypoint sees, or -1."""
        return self._keypoints["point"]

    def grow_keypoints(self, count: int) -> Rows:
        """Append keypoints that see no point; their rows."""
        return self._keypoints.grow(count)

    def grow_points(self, count: int) -> None:
        """Append points that no keypoint sees."""
        self._points.grow(count)

    def of(self, points: NDArray[np.integer]) -> tuple[Rows, Rows]:
        """Keypoints of all `points`, and the place in `points` of each; those of one point in their order."""
        place = np.arange(len(points))
        row = self._points["first"][points]
        rows, places = [np.empty(0, dtype=np.intp)], [np.empty(0, dtype=np.intp)]
        while len(row):
            seen = row >= 0
            row, place = row[seen], place[seen]
            rows.append(row)
            places.append(place)
            row = self._keypoints["next"][row]
        return np.concatenate(rows), np.concatenate(places)

    def in_order(self, points: NDArray[np.integer]) -> tuple[Rows, Rows]:
        """As :meth:`of`, point after point; each has its keypoints in the order they were linked."""
        rows, places = self.of(points)
        order = np.argsort(places, kind="stable")
        return rows[order], places[order]

    def link(self, rows: Rows, points: NDArray[np.integer]) -> None:
        """Let keypoints that see nothing see `points`, each behind the others of its point."""
        if not len(rows):
            return
        order = np.argsort(points, kind="stable")
        rows, points = rows[order], points[order]
        is_first = np.append(True, points[1:] != points[:-1])
        is_last = np.append(is_first[1:], True)
        seen, begin, end = points[is_first], rows[is_first], rows[is_last]
        self._keypoints["next"][rows] = np.where(is_last, NONE, np.append(rows[1:], NONE))
        before = self._points["last"][seen]
        follows = before >= 0
        self._keypoints["next"][before[follows]] = begin[follows]
        self._points["first"][seen[~follows]] = begin[~follows]
        self._points["last"][seen] = end
        self._keypoints["point"][rows] = points

    def unlink(self, rows: Rows) -> None:
        """Let keypoints see nothing."""
        points = self.point[rows]
        points = np.unique(points[points >= 0])
        members, places = self.of(points)
        self._keypoints["point"][rows] = NONE
        stays: BoolArray = self.point[members] >= 0
        self._points["first"][points] = self._points["last"][points] = NONE
        self.link(members[stays], points[places[stays]])
