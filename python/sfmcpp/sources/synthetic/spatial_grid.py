"""Points sorted into the cells of a cubic grid, to find those near a place without looking at all."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model.arrays import FloatArray

_NEIGHBOURS = np.array(list(product((-1, 0, 1), repeat=2)))
# So many cells along each axis that their number still fits into 63 bits.
_MOST_CELLS = 1_000_000


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
