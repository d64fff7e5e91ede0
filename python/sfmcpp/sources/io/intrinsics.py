"""Intrinsic parameters between camera models, without loss or not at all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import DatasetError
from sfmcpp.model import camera_model
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.problem import Problem
from sfmcpp.sources.io.checks import LARGEST_COUNT, require_metadata_length

PERSPECTIVE = camera_model("perspective").intrinsics
BAL = camera_model("bal").intrinsics
_DEFAULTS = np.array([1.0 if name == "aspect" else 0.0 for name in PERSPECTIVE])


def matrix_fault(matrix: FloatArray) -> str | None:
    """What keeps a matrix (3, 3) from being the calibration matrix of a camera, or None."""
    (fu, _, _), (zero, fv, _), last = matrix
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        aspect = np.float64(fv) / np.float64(fu)
    if fu > 0 and fv > 0 and 0 < aspect < np.inf and zero == 0 and np.array_equal(last, [0, 0, 1]):
        return None
    rule = "must be [[fu, skew, cu], [0, fv, cv], [0, 0, 1]], fu, fv and their ratio positive and finite"
    return f"the calibration matrix is {matrix.tolist()}: {rule}"


def pinhole_of_matrix(matrix: FloatArray) -> FloatArray:
    """``(f, aspect, cx, cy, skew)`` (5,) of a calibration matrix (3, 3)."""
    (fu, skew, cu), (_, fv, cv), _ = matrix
    return np.array([fu, fv / fu, cu, cv, skew])


def perspective_columns(*names: str) -> list[int]:
    """Columns of the named parameters in the perspective model."""
    return [PERSPECTIVE.index(name) for name in names]


def perspective_rows(count: int) -> FloatArray:
    """Rows (count, K) of perspective intrinsics: aspect 1, all else 0."""
    return np.tile(_DEFAULTS, (count, 1))


def fixed_but(count: int, *free: str) -> BoolArray:
    """Mask (count, K) of fixed perspective intrinsics in which only `free` are not fixed."""
    return np.tile([name not in free for name in PERSPECTIVE], (count, 1))


def as_perspective(problem: Problem) -> tuple[FloatArray, BoolArray]:
    """Intrinsics (G, K) of any camera model in the perspective one, and which of them are fixed."""
    columns = perspective_columns(*problem.intrinsic_names)
    values = perspective_rows(len(problem.intrinsics))
    fixed = np.ones(values.shape, dtype=np.bool_)
    values[:, columns] = problem.intrinsics
    fixed[:, columns] = problem.fixed_intrinsics
    return values, fixed


def image_sizes_of_intrinsics(problem: Problem, path: Path) -> NDArray[np.int64]:
    """Width and height (G, 2) of the images of each row of intrinsics [px].

    Where the metadata do not tell, they are what just covers the observations.

    Raises
    ------
    DatasetError
        If there are not as many in the metadata as rows.
    """
    stored = problem.metadata.extra.get("colmap_camera_sizes")
    if stored is not None:
        require_metadata_length("colmap_camera_sizes", stored, len(problem.intrinsics), path)
        return np.asarray(stored)
    rows = problem.intrinsics_index
    sizes = np.ones((len(problem.intrinsics), 2), dtype=np.int64)
    if problem.metadata.image_sizes is not None:
        sizes[rows] = problem.metadata.image_sizes
        return sizes
    largest = np.minimum(np.ceil(problem.pixels), LARGEST_COUNT).astype(np.int64)
    np.maximum.at(sizes, rows[problem.camera_index], largest)
    return sizes


def require_defaults_except(values: FloatArray, kept: tuple[str, ...], format_name: str, path: Path) -> None:
    """Raise a DatasetError if a perspective parameter that a format cannot hold is set."""
    held = [name in kept for name in PERSPECTIVE]
    good = (values == _DEFAULTS) | held
    if not good.all():
        row, column = np.argwhere(~good)[0]
        what = f"intrinsics[{row}]: {PERSPECTIVE[column]} = {values[row, column]}"
        raise DatasetError(path, f"{what} cannot be kept in {format_name}")


def as_bal(problem: Problem, format_name: str, path: Path) -> tuple[FloatArray, FloatArray]:
    """Private rows ``f, k1, k2`` (C, 3), and the pixels (M, 2) counted from the principal point.

    Raises
    ------
    DatasetError
        If the aspect ratio is not 1, or there is skew or any distortion beyond k1 and k2.
    """
    values, _ = as_perspective(problem)
    require_defaults_except(values, (*BAL, "cx", "cy"), format_name, path)
    private = values[problem.intrinsics_index]
    principal = private[:, perspective_columns("cx", "cy")]
    pixels = problem.pixels - principal[problem.camera_index] if principal.any() else problem.pixels
    return private[:, perspective_columns(*BAL)], pixels
