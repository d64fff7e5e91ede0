"""Intrinsic parameters between camera models, without loss or not at all."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from itertools import compress
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import DatasetError
from sfmcpp.geometry.pinhole import PINHOLE, to_normalised, to_pixels, undistorted_pixels
from sfmcpp.model import camera_model
from sfmcpp.model.arrays import BoolArray, FloatArray, IndexArray, largest_of_each
from sfmcpp.model.camera_models import PERSPECTIVE
from sfmcpp.model.problem import Problem
from sfmcpp.sources.io.checks import LARGEST_COUNT, require_image_sizes, require_metadata_length

BAL = camera_model("bal").intrinsics
# If the search for the ray of a pixel ends farther from it, there is none.
_FOUND_PX = 0.5
# Step of numeric derivatives of undistorted pixels.
_STEP_PX = 1e-3
_DEFAULTS = np.array([1.0 if name == "aspect" else 0.0 for name in PERSPECTIVE])


def matrix_fault(matrix: FloatArray) -> str | None:
    """Reason why a matrix (3, 3) is no calibration matrix of a camera, or None."""
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


def needed_parameters(values: FloatArray) -> set[str]:
    """Names of the perspective parameters of one row that differ from their defaults."""
    return set(compress(PERSPECTIVE, (values != _DEFAULTS).tolist()))


def smallest_model(models: Mapping[str, Collection[str]], values: FloatArray, fixed: BoolArray) -> str | None:
    """Choose a camera model for one row of perspective intrinsics.

    Parameters
    ----------
    models : mapping
        Names of models, the smallest first, and the perspective parameters that each can hold.
    values, fixed : (K,) float64, bool
        The row.

    Returns
    -------
    str or None
        The first model that holds what is set and what is free, else the first that holds what is set.
    """
    needed = needed_parameters(values)
    free = set(compress(PERSPECTIVE, (~fixed).tolist()))
    fitting = (
        name for wanted in (needed | free, needed) for name, held in models.items() if wanted <= {*held}
    )
    return next(fitting, None)


def model_of_row(
    row: int,
    models: Mapping[str, Collection[str]],
    values: FloatArray,
    fixed: BoolArray,
    path: Path,
) -> str:
    """:func:`smallest_model` of a problem's row of intrinsics, or a DatasetError with what none can hold."""
    name = smallest_model(models, values, fixed)
    if name is None:
        raise no_model(row, models, values, path)
    return name


def no_model(row: int, models: Collection[str], values: FloatArray, path: Path) -> DatasetError:
    """Make the error of a row of intrinsics that none of these camera models holds."""
    needed = needed_parameters(values)
    given = ", ".join(f"{p} = {v}" for p, v in zip(PERSPECTIVE, values, strict=True) if p in needed)
    return DatasetError(
        path, f"intrinsics[{row}]: no supported camera model ({', '.join(models)}) has {given}"
    )


def has_distortion(problem: Problem) -> bool:
    """Whether any lens of a pinhole model bends rays."""
    return bool(as_perspective(problem)[0][:, PINHOLE:].any())


def pixels_without_inverse(problem: Problem) -> int:
    """How many observations of cameras of a pinhole model no ray explains, or none that was found.

    A lens with strong terms has a farthest circle that it takes rays to.
    """
    rows, index = as_perspective(problem)[0], problem.intrinsics_index[problem.camera_index]
    ideal = to_normalised(undistorted_pixels(problem.pixels, rows, index), rows[index, :PINHOLE])
    apart = np.linalg.norm(to_pixels(ideal, rows[index]) - problem.pixels, axis=1)
    return int(np.count_nonzero(~(apart < _FOUND_PX)))


def has_square_pixels(problem: Problem) -> bool:
    """Whether no camera of a pinhole model has an aspect ratio or a skew."""
    columns = perspective_columns("aspect", "skew")
    return bool((as_perspective(problem)[0][:, columns] == (1.0, 0.0)).all())


class CornerLenses(NamedTuple):
    """Intrinsics of the perspective model for pixels that count from the corner of the image.

    Pixels of the BAL model count from the principal point, wherever it is in the image; it is then put into
    the middle. ``origin`` (G, 2) [px] is what pixels need added to count from the corner: zero for all
    other models.
    """

    values: FloatArray  # (G, K)
    fixed: BoolArray  # (G, K)
    sizes: NDArray[np.int64]  # (G, 2): width and height [px]
    origin: FloatArray  # (G, 2)


def lenses_from_corner(problem: Problem, path: Path) -> CornerLenses:
    """Intrinsics of a problem, and its image sizes, as formats have them that count pixels from the corner.

    Where the metadata do not tell the sizes, they are what just covers the observations.

    Raises
    ------
    DatasetError
        If the sizes in the metadata are none, or not as many as rows or cameras.
    """
    values, fixed = as_perspective(problem)
    centred = problem.camera_model == "bal"
    sizes = _image_sizes(problem, centred, path)
    origin = sizes / 2.0 if centred else np.zeros((len(values), 2))
    values[:, perspective_columns("cx", "cy")] += origin
    return CornerLenses(values, fixed, sizes, origin)


def _image_sizes(problem: Problem, centred: bool, path: Path) -> NDArray[np.int64]:
    """Width and height (G, 2) of the images of each row [px]; a size with a zero in it is not known."""
    sizes = _known_sizes(problem, path)
    covering = _covering_sizes(problem, centred)
    return np.where((sizes != 0).all(axis=1, keepdims=True), sizes, covering)


def _known_sizes(problem: Problem, path: Path) -> NDArray[np.int64]:
    """Sizes (G, 2) as the metadata have them, 0 where they have none."""
    count, index = len(problem.intrinsics), problem.intrinsics_index
    stored = problem.metadata.extra.get("colmap_camera_sizes")
    if stored is not None:
        require_metadata_length("colmap_camera_sizes", stored, count, path)
        return np.asarray(stored, dtype=np.int64)
    sizes = np.zeros((count, 2), dtype=np.int64)
    require_image_sizes(problem, path)
    if problem.metadata.image_sizes is not None:
        of_images = np.asarray(problem.metadata.image_sizes, dtype=np.int64)
        known = np.flatnonzero((of_images > 0).all(axis=1))
        sizes[index[known]] = of_images[known]
        _require_one_size(of_images[known], sizes[index[known]], index[known], path)
    return sizes


def _require_one_size(
    of_images: NDArray[np.int64], of_rows: NDArray[np.int64], rows: IndexArray, path: Path
) -> None:
    """Raise a DatasetError at the first row of intrinsics whose images (k, 2) are of several sizes [px]."""
    differs = (of_images != of_rows).any(axis=1)
    if differs.any():
        k = int(np.argmax(differs))
        one, other = ("×".join(map(str, sizes[k])) for sizes in (of_images, of_rows))
        rule = "intrinsics in pixels are of one size of image: give each size a row of its own"
        raise DatasetError(path, f"intrinsics[{rows[k]}] have images of {one} and {other} px: {rule}")


def _covering_sizes(problem: Problem, centred: bool) -> NDArray[np.int64]:
    """Sizes (G, 2) of images that just cover the observations."""
    sides, reach = (2, np.abs(problem.pixels)) if centred else (1, problem.pixels)
    rows = problem.intrinsics_index[problem.camera_index]
    largest: FloatArray = np.ceil(largest_of_each(rows, reach, len(problem.intrinsics), least=1.0))
    return np.minimum(sides * largest, LARGEST_COUNT).astype(np.int64)


def require_defaults_except(values: FloatArray, kept: tuple[str, ...], format_name: str, path: Path) -> None:
    """Raise a DatasetError if a perspective parameter that a format cannot hold is set."""
    held = [name in kept for name in PERSPECTIVE]
    good = (values == _DEFAULTS) | held
    if not good.all():
        row, column = np.argwhere(~good)[0]
        what = f"intrinsics[{row}]: {PERSPECTIVE[column]} = {values[row, column]}"
        raise DatasetError(path, f"{what} cannot be kept in {format_name}")


def require_positive_lengths(values: FloatArray, path: Path) -> None:
    """Raise a DatasetError if a focal length or an aspect ratio of perspective `values` is not positive."""
    names = ("f", "aspect")
    lengths = values[:, perspective_columns(*names)]
    if (lengths > 0).all():
        return
    row, column = np.argwhere(~(lengths > 0))[0]
    raise DatasetError(path, f"intrinsics[{row}]: {names[column]} = {lengths[row, column]}: must be positive")


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


def undistorted(problem: Problem, values: FloatArray) -> Problem:
    """Pixels, and their uncertainties, as cameras of perspective `values` (G, K) without distortion."""
    of_view = problem.intrinsics_index[problem.camera_index]

    def moved(pixels: FloatArray) -> FloatArray:
        return undistorted_pixels(pixels, values, of_view)

    steps = _STEP_PX * np.eye(2)
    slopes = [
        (moved(problem.pixels + step) - moved(problem.pixels - step)) / (2 * _STEP_PX) for step in steps
    ]
    jacobians = np.stack(slopes, axis=2)
    stated = problem.uncertainty.as_covariances(problem.num_observations)
    covariances = jacobians @ stated @ np.swapaxes(jacobians, 1, 2)
    return replace(problem, pixels=moved(problem.pixels), sigma_px=None, covariance_px2=covariances)
