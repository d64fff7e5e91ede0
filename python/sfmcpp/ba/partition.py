"""Partition of the points over ranks: equal work, and few cameras for each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray, IndexArray

Numbers = NDArray[np.int64]

# What an observation costs beside the pairs that it makes with others of its point, in pairs. With the pairs
# alone one of two ranks computed 15 to 30 % longer than the other on a city of 1,000 cameras, with 24 to 64
# no more than 8 %; photo collections and BAL problem-49 do not feel it.
_WORK_OF_OBSERVATION = 32
# And a point beside its observations. Without it rank 0 of two had 6 % more points of a city of 3,000 cameras
# than it should, which took 2 % more memory; computing took as long, to 2 %, with 64 as without.
_WORK_OF_POINT = 64
_LEAST_BINS = 1 << 16
_ROWS_AT_ONCE = 1 << 18


def partition_points(problem: Problem, count: int) -> IndexArray:
    """Cut a problem into parts that take the same work and see few cameras each.

    Cameras follow one another along the graph of who shares points (reverse Cuthill–McKee), points along
    the mean place of their cameras, which keeps those of the same cameras together.

    Parameters
    ----------
    problem : Problem
        Its indices must be in range.
    count : int
        Number of parts.

    Returns
    -------
    (N,) int32
        Part of each point.
    """
    links = camera_links(problem.camera_index, problem.point_index, problem.num_cameras)
    tracks = Tracks(problem.camera_index, problem.point_index, problem.num_points)
    return tracks.cut(camera_places(links, problem.num_cameras), count)


def camera_links(
    camera_index: NDArray[np.int32], point_index: NDArray[Any], num_cameras: int
) -> NDArray[np.int64]:
    """Pairs a·C + b, each once, of cameras that follow one another among those of a point."""
    order = np.lexsort((camera_index, point_index))
    links = np.empty(0, np.int64)
    for begin in range(0, len(order) - 1, _ROWS_AT_ONCE):
        rows = order[begin : begin + _ROWS_AT_ONCE + 1]
        cameras, points = camera_index[rows].astype(np.int64), point_index[rows]
        same = points[1:] == points[:-1]
        links = np.union1d(links, cameras[:-1][same] * num_cameras + cameras[1:][same])
    return links


def camera_places(links: NDArray[np.int64], num_cameras: int) -> Numbers:
    """Place of each of C cameras (C,) along the graph that the links make."""
    from scipy.sparse import coo_array, csr_array
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    places = np.empty(num_cameras, np.int64)
    if not num_cameras:
        return places
    ends = (links // num_cameras, links % num_cameras)
    half = coo_array((np.ones(len(links), np.int8), ends), (num_cameras, num_cameras))
    places[reverse_cuthill_mckee(csr_array(half + half.T), symmetric_mode=True)] = np.arange(num_cameras)
    return places


class Tracks:
    """All observations of some points of a problem: which cameras observe them.

    Parameters
    ----------
    camera_index, point_index : (m,) int
        Of each observation; points count from `first` on.
    count : int
        Number of these points.
    first, of : int
        Which of how many points of the whole is the first one. Default: these are all.
    """

    def __init__(
        self,
        camera_index: NDArray[np.int32],
        point_index: NDArray[Any],
        count: int,
        first: int = 0,
        of: int | None = None,
    ) -> None:
        self._cameras, self._points = camera_index, point_index - first if first else point_index
        self._count, self._first, self._of = count, first, count if of is None else of

    def cut(
        self,
        places: Numbers,
        count: int,
        summed: Callable[[FloatArray], FloatArray] = lambda work: work,
    ) -> IndexArray:
        """Cut along the cameras' places into so many parts.

        Parameters
        ----------
        places : (C,) int
            Those of all cameras, each once.
        count : int
            Number of parts.
        summed : callable
            Sums of an array over all who have tracks of this problem.

        Returns
        -------
        (n,) int32
            Part of each of these points.
        """
        bins = len(places) * (1 + _LEAST_BINS // max(len(places), 1))
        images = np.bincount(self._points, minlength=self._count).astype(np.float64)
        bin_of = (self._mean_places(places, images) * (bins / max(len(places), 1))).astype(np.int64)
        work = images * (images + _WORK_OF_OBSERVATION) + _WORK_OF_POINT
        of_bins = summed(np.bincount(bin_of, work, bins).astype(np.float64))
        middles = np.cumsum(of_bins) - 0.5 * of_bins
        part_of_bin = np.searchsorted(of_bins.sum() * np.arange(1, count) / count, middles, side="right")
        return part_of_bin.astype(np.int32)[bin_of]

    def _mean_places(self, places: Numbers, images: FloatArray) -> FloatArray:
        """Mean place of each point's cameras, below C; points of the same ones stay in their order."""
        total = np.bincount(self._points, places[self._cameras], self._count)
        numbers = self._first + np.arange(self._count)
        return total / np.maximum(images, 1.0) + numbers / max(self._of, 1)
