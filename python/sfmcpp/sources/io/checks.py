"""Validation of problems that are read or written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model.arrays import BoolArray, IndexArray
from sfmcpp.model.checks import is_rotation
from sfmcpp.model.metadata import require_entries
from sfmcpp.model.problem import Problem
from sfmcpp.model.uncertainty import first_bad_covariance

LARGEST_MAGNITUDE = 1e150
_ROWS_AT_ONCE = 1 << 18
LARGEST_COUNT = int(np.iinfo(np.int32).max)


def first_duplicate(
    camera_index: NDArray[Any], point_index: NDArray[Any], num_cameras: int
) -> tuple[int, int] | None:
    """Two observations of the same point by the same camera, the earlier first, or None."""
    if _is_strictly_increasing(point_index, camera_index) or _is_strictly_increasing(
        camera_index, point_index
    ):
        return None
    keys = point_index.astype(np.int64)
    keys *= num_cameras
    keys += camera_index
    ordered = np.sort(keys)
    if (ordered[1:] != ordered[:-1]).all():
        return None
    order = np.argsort(keys, kind="stable")
    repeated = np.flatnonzero(np.diff(keys[order]) == 0)
    worst = int(repeated[np.argmin(order[repeated + 1])])
    return int(order[worst]), int(order[worst + 1])


def _is_strictly_increasing(first: NDArray[Any], second: NDArray[Any]) -> bool:
    """Whether each pair (first[i], second[i]) comes after the one before it, as words in a dictionary do."""
    for begin in range(0, len(first) - 1, _ROWS_AT_ONCE):
        rows = slice(begin, begin + _ROWS_AT_ONCE + 1)
        a, b = first[rows], second[rows]
        if not ((a[1:] > a[:-1]) | ((a[1:] == a[:-1]) & (b[1:] > b[:-1]))).all():
            return False
    return True


def require_magnitudes(problem: Problem, path: Path) -> None:
    """Raise a DatasetError naming the first number that is not finite, or too large to be converted."""
    for name in ("cameras", "intrinsics", "points", "pixels"):
        _require_finite(name, getattr(problem, name), path)


def require_valid(problem: Problem, path: Path) -> None:
    """Raise a DatasetError naming the first thing in `problem` that no file can hold.

    That is: a value that is not finite, or so large that converting it would overflow; an index out of
    range; a camera whose first three columns are no rotation; a standard deviation that is not positive;
    a covariance that is none, or beside standard deviations; a point observed twice by one camera; metadata
    of another kind than their name says.
    """
    require_magnitudes(problem, path)
    _require_in_range("camera_index", problem.camera_index, problem.num_cameras, path)
    _require_in_range("point_index", problem.point_index, problem.num_points, path)
    _require_in_range("intrinsics_index", problem.intrinsics_index, len(problem.intrinsics), path)
    _require_rotations(problem, path)
    _require_positive_sigma(problem, path)
    _require_covariances(problem, path)
    duplicate = first_duplicate(problem.camera_index, problem.point_index, problem.num_cameras)
    if duplicate is not None:
        raise DatasetError(path, "observations {} and {} are of the same camera and point".format(*duplicate))
    try:
        require_entries(problem.metadata.extra)
        problem.metadata.require_names()
    except InvalidArgument as error:
        raise DatasetError(path, str(error)) from error


def finite_rows(array: NDArray[np.float64]) -> BoolArray:
    """Whether all numbers of each ``array[i]`` are finite."""
    finite = np.isfinite(array)
    if finite.all():
        return np.ones(len(array), dtype=np.bool_)
    return np.asarray(finite.all(axis=tuple(range(1, array.ndim))))


def require_metadata_length(what: str, value: Any, length: int, path: Path) -> None:
    """Raise a DatasetError unless metadata `value` has `length` entries."""
    if len(value) != length:
        raise DatasetError(path, f"metadata {what} has {len(value)} entries: must be {length}")


def require_image_sizes(problem: Problem, path: Path) -> None:
    """Raise a DatasetError unless the metadata tell no image sizes, or a width and height for each camera."""
    if problem.metadata.image_sizes is None:
        return
    sizes, count = np.asarray(problem.metadata.image_sizes), problem.num_cameras
    if sizes.shape != (count, 2) or (sizes.size and sizes.dtype.kind not in "iu"):
        found = f"{sizes.dtype.name} {sizes.shape}"
        raise DatasetError(path, f"metadata image_sizes is {found}: must be integers ({count}, 2)")
    if not _all_within(sizes, 0, LARGEST_COUNT):
        worst = sizes.min() if sizes.min() < 0 else sizes.max()
        raise DatasetError(path, f"metadata image_sizes has {worst}: must be from 0 to {LARGEST_COUNT} px")


def image_names(problem: Problem, path: Path) -> list[str]:
    """Names of the images of all cameras from the metadata, or numbered from 1 where there are none."""
    names = problem.metadata.names(problem.num_cameras)
    require_metadata_length("image_names", names, problem.num_cameras, path)
    return names


def point_colors(problem: Problem, default: tuple[int, int, int], path: Path) -> NDArray[np.uint8]:
    """Colours (N, 3) of the points from the metadata, or `default` for all where there are none."""
    colors = problem.metadata.point_colors
    if colors is None:
        return np.tile(np.array(default, dtype=np.uint8), (problem.num_points, 1))
    require_metadata_length("point_colors", colors, problem.num_points, path)
    if colors.dtype != np.uint8 or colors.shape != (problem.num_points, 3):
        found = f"{colors.dtype.name} {colors.shape}"
        raise DatasetError(path, f"metadata point_colors is {found}: must be uint8 ({problem.num_points}, 3)")
    return colors


def _all_within(array: NDArray[Any], lowest: float, highest: float) -> bool:
    """Whether all numbers are from `lowest` to `highest`, and none is not a number; takes no memory."""
    return not array.size or bool(array.min() >= lowest and array.max() <= highest)


def _require_finite(name: str, array: NDArray[np.float64], path: Path) -> None:
    if not _all_within(array, -LARGEST_MAGNITUDE, LARGEST_MAGNITUDE):
        good = np.abs(array) <= LARGEST_MAGNITUDE
        where = np.argwhere(~good)[0].tolist()
        rule = f"must be finite, at most {LARGEST_MAGNITUDE:g} in magnitude"
        raise DatasetError(path, f"{name}{where} is {array[tuple(where)]}: {rule}")


def _require_in_range(name: str, index: IndexArray, size: int, path: Path) -> None:
    if not _all_within(index, 0, size - 1):
        worst = int(np.argmin((index >= 0) & (index < size)))
        raise DatasetError(path, f"{name}[{worst}] is {index[worst]}: must be from 0 to {size - 1}")


def _require_rotations(problem: Problem, path: Path) -> None:
    if not problem.is_metric:
        return
    good = is_rotation(problem.rotations)
    if not good.all():
        worst = int(np.argmin(good))
        raise DatasetError(path, f"cameras[{worst}]: its first three columns are not a rotation matrix")


def _require_positive_sigma(problem: Problem, path: Path) -> None:
    if problem.sigma_px is None:
        return
    lowest, highest = 1 / LARGEST_MAGNITUDE, LARGEST_MAGNITUDE
    if not _all_within(problem.sigma_px, lowest, highest):
        worst = int(np.argmin((problem.sigma_px >= lowest) & (problem.sigma_px <= highest)))
        rule = f"must be positive, from {lowest:g} to {highest:g}"
        raise DatasetError(path, f"sigma_px[{worst}] is {problem.sigma_px[worst]}: {rule}")


def _require_covariances(problem: Problem, path: Path) -> None:
    if problem.covariance_px2 is None:
        return
    if problem.sigma_px is not None:
        raise DatasetError(path, "covariance_px2 stands beside sigma_px: must be one of them")
    _require_finite("covariance_px2", problem.covariance_px2, path)
    bad = first_bad_covariance(problem.covariance_px2)
    if bad is not None:
        worst, rule = bad
        found = problem.covariance_px2[worst].tolist()
        raise DatasetError(path, f"covariance_px2[{worst}] is {found}: must be {rule}")


def fault_of_image_name(name: str) -> str | None:
    """Why lists of images cannot hold a name, a line each; None if they can."""
    if not name or name != name.strip() or any(c in name for c in "\0\r\n"):
        return "must not be empty, start or end with white space, or hold a line break or NUL"
    try:
        name.encode("utf-8")
    except UnicodeEncodeError as error:  # bytes that are no text
        return f"cannot be written as UTF-8: {error.reason}"
    return None
