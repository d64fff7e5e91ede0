"""Observations of many points as arrays: checks, rays and sums over the observations of each point."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry.pinhole import PINHOLE, homogeneous, pinhole_rows, to_normalised, undistorted_pixels
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray, IndexArray, finite_array
from sfmcpp.model.camera_models import require_pinhole

# Columns of so many observations stay in a core's cache, and are too small for pages of their own.
_OBSERVATIONS_AT_ONCE = 1 << 13


def require_metric(problem: Problem) -> None:
    """Raise InvalidArgument unless `problem` has poses, known intrinsics and observations of its own."""
    require_pinhole(problem.camera_model)
    for name in ("cameras", "intrinsics", "pixels"):
        array = getattr(problem, name)
        finite_array(name, array, array.shape)
    _require_in_range("camera_index", problem.camera_index, problem.num_cameras)
    _require_in_range("point_index", problem.point_index, problem.num_points)
    _require_in_range("intrinsics_index", problem.intrinsics_index, len(problem.intrinsics))


def require_points(problem: Problem, points: FloatArray) -> FloatArray:
    """`points` as (N, 3) float64 of the N points of `problem` (values may be not a number)."""
    array = np.asarray(points, dtype=np.float64)
    if array.shape != (problem.num_points, 3):
        raise InvalidArgument(f"points: shape {array.shape}, must be ({problem.num_points}, 3)")
    return array


def _require_in_range(name: str, index: IndexArray, size: int) -> None:
    good = (index >= 0) & (index < size)
    if not good.all():
        worst = int(np.argmin(good))
        raise InvalidArgument(f"{name}[{worst}] = {index[worst]}: must be from 0 to {size - 1}")


def in_pieces(problem: Problem) -> Iterator[slice]:
    """Some thousand of the observations at a time."""
    for begin in range(0, problem.num_observations, _OBSERVATIONS_AT_ONCE):
        yield slice(begin, begin + _OBSERVATIONS_AT_ONCE)


def intrinsics_of_observations(problem: Problem) -> FloatArray:
    """(M, 5) intrinsics of the camera of each observation, (M, 12) where there is distortion."""
    return np.asarray(pinhole_rows(problem.intrinsics)[problem.intrinsics_index[problem.camera_index]])


def normalised_pixels(problem: Problem) -> FloatArray:
    """(M, 2) observed image points at depth one."""
    rows, index = pinhole_rows(problem.intrinsics), problem.intrinsics_index[problem.camera_index]
    pixels = problem.pixels
    if rows.shape[1] > PINHOLE:
        pixels = undistorted_pixels(pixels, rows, index)
    return to_normalised(pixels, rows[index, :PINHOLE])


def observed_rays(problem: Problem) -> FloatArray:
    """(M, 3) unit vectors in the world from each camera towards what it observes."""
    in_camera = homogeneous(normalised_pixels(problem))
    in_camera /= np.linalg.norm(in_camera, axis=1, keepdims=True)
    return np.asarray(np.einsum("mij,mj->mi", problem.rotations[problem.camera_index], in_camera))


def points_in_cameras(problem: Problem, points: FloatArray) -> FloatArray:
    """(M, 3) the point of each observation, in its camera."""
    in_camera, columns_of = np.empty((problem.num_observations, 3)), camera_columns(problem, points)
    for rows in in_pieces(problem):
        in_camera[rows] = columns_of(rows).T
    return in_camera


def camera_columns(problem: Problem, points: FloatArray) -> Callable[[slice], FloatArray]:
    """A function that gives some rows of :func:`points_in_cameras` as columns (3, m).

    Several times faster than a matrix gathered for each observation.
    """
    cameras = np.ascontiguousarray(problem.cameras.reshape(-1, 12).T)

    def columns_of(rows: slice) -> FloatArray:
        camera = cameras.take(problem.camera_index[rows], axis=1)
        x, y, z = points.take(problem.point_index[rows], axis=0).T - camera[3::4]
        with np.errstate(invalid="ignore", over="ignore"):  # points at infinity
            return np.stack([camera[j] * x + camera[4 + j] * y + camera[8 + j] * z for j in range(3)])

    return columns_of


def num_views(problem: Problem) -> NDArray[np.int64]:
    """(N,) number of observations of each point."""
    return np.bincount(problem.point_index, minlength=problem.num_points)


def tracks_of_one_length(
    problem: Problem, numbers_of_track: Callable[[int], int], at_once: int
) -> Iterator[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Points (T,) and their observations (T, L), two at least, of all tracks of each length.

    They come in pieces that fit in memory: where a track of length L takes ``numbers_of_track(L)`` numbers, a
    piece takes `at_once`, or little more.
    """
    by_point = np.argsort(problem.point_index, kind="stable")
    views = num_views(problem)
    start = np.cumsum(views) - views
    for length in np.unique(views[views > 1]).tolist():
        tracks = np.flatnonzero(views == length)
        size = len(tracks) * numbers_of_track(length)
        for some in np.array_split(tracks, min(len(tracks), -(-size // at_once))):
            yield some, by_point[start[some, None] + np.arange(length)]


def sum_by_point(problem: Problem, values: FloatArray) -> FloatArray:
    """(N, K) sums of `values` (M, K) over the observations of each point, in their order."""
    index, count = problem.point_index, problem.num_points
    return np.stack([np.bincount(index, column, count) for column in values.T], axis=1)


def mean_by_point(problem: Problem, values: FloatArray) -> FloatArray:
    """(N, K) means of `values` (M, K) over the observations of each point; zero for points without."""
    return sum_by_point(problem, values) / np.maximum(num_views(problem), 1)[:, None]


def sum_outer_by_point(problem: Problem, rows: FloatArray) -> FloatArray:
    """(N, K, K) sums of ``row rowᵀ`` over the `rows` (M, R, K) of the observations of each point."""
    size = rows.shape[-1]
    upper = np.triu_indices(size)
    products = np.einsum("mrk,mrk->mk", rows[..., upper[0]], rows[..., upper[1]])
    sums = np.empty((problem.num_points, size, size))
    sums[:, upper[0], upper[1]] = sum_by_point(problem, products)
    sums[:, upper[1], upper[0]] = sums[:, upper[0], upper[1]]
    return sums
