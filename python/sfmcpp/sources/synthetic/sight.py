"""Visibility: how far the cameras of a scene see, and occlusion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from itertools import product

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model.arrays import BoolArray, FloatArray, IndexArray
from sfmcpp.sources.synthetic.image_geometry import ImageGeometry

_NEIGHBOURS = np.array(list(product((-1, 0, 1), repeat=2)))
# So many cells along each axis that their number still fits into 63 bits.
_MOST_CELLS = 1_000_000

Hides = Callable[[FloatArray, FloatArray], BoolArray]


@dataclass(frozen=True)
class Sight:
    """Limits of the views of cameras besides their images.

    Attributes
    ----------
    max_depth_m : float or (N,) float64
        Greatest depth, along the optical axis, in which each point is still recognised [m].
    hides : callable, optional
        From a camera centre (3,) and points (N, 3) to a mask (N,) of those hidden from it.
    """

    max_depth_m: float | FloatArray
    hides: Hides | None = None


class Lookout:
    """Projects into each camera only the points near it.

    Points are sorted into one grid for each doubling of the depth in which they are recognised, so that
    a few points recognised from afar do not make every camera look at far points.

    Parameters
    ----------
    geometry : ImageGeometry
        The camera.
    points : (N, 3) float64
        The points of the scene.
    sight : Sight
        What limits the views.
    """

    def __init__(self, geometry: ImageGeometry, points: FloatArray, sight: Sight) -> None:
        self._geometry = geometry
        self._points = points
        self._max_depth_m = np.broadcast_to(np.asarray(sight.max_depth_m, dtype=np.float64), len(points))
        self._hides = sight.hides
        self._shells = _shells(geometry, points, self._max_depth_m)

    def view(self, camera: FloatArray) -> tuple[IndexArray, FloatArray]:
        """Indices of the points that `camera` (3, 4) sees, and their pixels."""
        near = np.concatenate([np.empty(0, np.intp), *(shell.near(camera) for shell in self._shells)])
        seen, pixels = self._geometry.project(camera, self._points[near], self._max_depth_m[near])
        indices = near[seen].astype(np.int32)
        if self._hides is None:
            return indices, pixels
        in_sight = ~self._hides(camera[:, 3], self._points[indices])
        return indices[in_sight], pixels[in_sight]


class SpatialGrid:
    """Points by cell; its memory grows with the points, not with the space they span.

    Parameters
    ----------
    points : (N, 3) float64
        At least one.
    cell_m : float
        Least edge of a cell [m].
    """

    def __init__(self, points: FloatArray, cell_m: float) -> None:
        self._lowest = points.min(axis=0)
        extent = float((points.max(axis=0) - self._lowest).max())
        self._cell_m = max(cell_m, extent / _MOST_CELLS)
        cells = self._cell(points)
        self._shape = cells.max(axis=0) + 1
        keys = self._key(cells)
        self._order = np.argsort(keys, kind="stable")
        self._keys = keys[self._order]

    def near(self, place: FloatArray) -> NDArray[np.intp]:
        """Indices of the points in the cell of `place` (3,) and in the 26 around it.

        All points no farther from `place` than the edge of a cell are among them.
        """
        cell = self._cell(place)
        columns = cell[:2] + _NEIGHBOURS
        columns = columns[((columns >= 0) & (columns < self._shape[:2])).all(axis=1)]
        bottom, top = max(cell[2] - 1, 0), min(cell[2] + 1, self._shape[2] - 1)
        if bottom > top:
            return self._order[:0]
        # Cells of one column follow each other, so each column is one run.
        starts = np.searchsorted(self._keys, self._column_key(columns) + bottom, side="left")
        stops = np.searchsorted(self._keys, self._column_key(columns) + top, side="right")
        runs = [self._order[start:stop] for start, stop in zip(starts, stops, strict=True)]
        return np.concatenate([self._order[:0], *runs])

    def _cell(self, places: FloatArray) -> NDArray[np.int64]:
        cells: NDArray[np.int64] = np.floor((places - self._lowest) / self._cell_m).astype(np.int64)
        return cells

    def _key(self, cells: NDArray[np.int64]) -> NDArray[np.int64]:
        keys: NDArray[np.int64] = self._column_key(cells[:, :2]) + cells[:, 2]
        return keys

    def _column_key(self, columns: NDArray[np.int64]) -> NDArray[np.int64]:
        keys: NDArray[np.int64] = (columns[:, 0] * self._shape[1] + columns[:, 1]) * self._shape[2]
        return keys


@dataclass(frozen=True)
class _Shell:
    """The points recognised in similar depths."""

    indices: NDArray[np.intp]
    grid: SpatialGrid
    ahead_m: float

    def near(self, camera: FloatArray) -> NDArray[np.intp]:
        middle_of_view = camera[:, 3] + self.ahead_m * camera[:, 2]
        return self.indices[self.grid.near(middle_of_view)]


def _shells(geometry: ImageGeometry, points: FloatArray, max_depth_m: FloatArray) -> list[_Shell]:
    octaves = np.floor(np.log2(max_depth_m))
    members = (np.flatnonzero(octaves == octave) for octave in np.unique(octaves))
    return [_shell(geometry, points, indices, float(max_depth_m[indices].max())) for indices in members]


def _shell(geometry: ImageGeometry, points: FloatArray, indices: NDArray[np.intp], depth_m: float) -> _Shell:
    ahead_m, radius_m = _sphere_around_view(depth_m, geometry.corner_tangent)
    return _Shell(indices, SpatialGrid(points[indices], radius_m), ahead_m)


def _sphere_around_view(depth_m: float, corner_tangent: float) -> tuple[float, float]:
    """Centre on the optical axis, and radius, of the smallest sphere around a view of that depth [m].

    It passes through the corners at the far end, and through the camera too if the view is narrow.
    """
    if corner_tangent >= 1:
        return depth_m, depth_m * corner_tangent
    radius_m = depth_m * (1 + corner_tangent**2) / 2
    return radius_m, radius_m


def enters(start: FloatArray, way: FloatArray, lower: FloatArray, upper: FloatArray) -> BoolArray:
    """Whether the ways (N, k) from `start` pass through the inside of boxes along the axes (slab method)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        to_lower, to_upper = (lower - start) / way, (upper - start) / way
    # Column by column: reductions over rows as short as these cost several times as much.
    entry = reduce(np.maximum, np.minimum(to_lower, to_upper).T)
    exit_ = reduce(np.minimum, np.maximum(to_lower, to_upper).T)
    inside: BoolArray = np.maximum(entry, 0) < np.minimum(exit_, 1)
    return inside
