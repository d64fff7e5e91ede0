"""From a problem to COLMAP's tables; what the metadata knows is kept, the rest gets defaults."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import DatasetError
from sfmcpp.geometry.quaternions import quaternion_from_rotation
from sfmcpp.model import Problem
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.sources.io.checks import (
    LARGEST_COUNT,
    finite_rows,
    point_colors,
    require_metadata_length,
    require_valid,
)
from sfmcpp.sources.io.colmap.camera_models import (
    MODELS,
    SUPPORTED,
    needed_parameters,
    params_from_intrinsics,
    smallest_model,
)
from sfmcpp.sources.io.colmap.tables import (
    LARGEST_ID,
    LARGEST_POINT_ID,
    NO_POINT,
    CameraTable,
    ImageTable,
    Int64Array,
    PointTable,
    Tables,
)
from sfmcpp.sources.io.intrinsics import PERSPECTIVE, as_perspective
from sfmcpp.sources.io.poses import pose_from_cameras
from sfmcpp.sources.io.rows import by_point, exclusive_sums, keypoint_ranks

_UNKNOWN_ERROR = -1.0


def tables_from_problem(problem: Problem, folder: Path) -> Tables:
    """COLMAP's tables of a problem.

    Raises
    ------
    DatasetError
        If an intrinsic parameter has no place in a supported camera model, an image name cannot be
        written, or metadata do not fit the problem.
    """
    require_valid(problem, folder)
    cameras = _cameras(problem, folder)
    point_ids = _extra(problem, "colmap_point_ids", np.arange(1, problem.num_points + 1), folder)
    keypoint_index = _extra(problem, "colmap_keypoint_index", keypoint_ranks(problem), folder)
    images = _images(problem, folder, cameras.ids, point_ids, keypoint_index)
    order, counts = by_point(problem)
    points = PointTable(
        folder,
        None,
        point_ids,
        positions=problem.points,
        colors=point_colors(problem, (0, 0, 0), folder),
        errors=_extra(problem, "colmap_point_errors", np.full(problem.num_points, _UNKNOWN_ERROR), folder),
        track_counts=counts,
        track_images=images.ids[problem.camera_index[order]],
        track_keypoints=keypoint_index[order],
    )
    tables = Tables(cameras, images, points)
    _require_readable(tables)
    return tables


def _require_readable(tables: Tables) -> None:
    """Refuse identifiers, sizes and numbers from the metadata that no reader would accept."""
    cameras, images, points = tables.cameras, tables.images, tables.points
    cameras.require_unique_ids(LARGEST_ID)
    images.require_unique_ids(LARGEST_ID)
    points.require_unique_ids(LARGEST_POINT_ID)
    sizes = (cameras.sizes >= 0) & (cameras.sizes <= LARGEST_COUNT)
    cameras.require(np.asarray(sizes.all(axis=1)), f"its image size must be from 0 to {LARGEST_COUNT}")
    points.require(np.isfinite(points.errors), "its error is not finite")
    images.require(_finite_keypoints(images), "one of its keypoints is not finite")


def _finite_keypoints(images: ImageTable) -> BoolArray:
    image = np.repeat(np.arange(len(images.ids)), images.keypoint_counts)
    bad = image[~finite_rows(images.keypoints)]
    return np.asarray(np.bincount(bad, minlength=len(images.ids)) == 0)


def _extra(problem: Problem, key: str, default: NDArray[Any], folder: Path) -> NDArray[Any]:
    value = problem.metadata.extra.get(key)
    if value is None:
        return default
    require_metadata_length(key, value, len(default), folder)
    return np.asarray(value)


def _cameras(problem: Problem, folder: Path) -> CameraTable:
    values, fixed = as_perspective(problem)
    names = problem.metadata.extra.get("colmap_camera_models")
    if names is None:
        names = [""] * len(values)
    require_metadata_length("colmap_camera_models", names, len(values), folder)
    models = [
        _model(row, *columns, folder) for row, columns in enumerate(zip(names, values, fixed, strict=True))
    ]
    return CameraTable(
        folder,
        None,
        _extra(problem, "colmap_camera_ids", np.arange(1, len(values) + 1), folder),
        models=models,
        sizes=_extra(problem, "colmap_camera_sizes", _sizes(problem), folder),
        params=[params_from_intrinsics(name, row) for name, row in zip(models, values, strict=True)],
    )


def _model(row: int, known: str, values: FloatArray, fixed: BoolArray, folder: Path) -> str:
    """Choose the model the row came with if it still holds its values, else the smallest that does."""
    needed = needed_parameters(values)
    if known in MODELS and needed <= set(MODELS[known].kept):
        return known
    free = {name for name, is_fixed in zip(PERSPECTIVE, fixed, strict=True) if not is_fixed}
    name = smallest_model(needed | free) or smallest_model(needed)
    if name is None or (MODELS[name].has_aspect and values[PERSPECTIVE.index("f")] == 0):
        values_set = ", ".join(f"{p} = {v}" for p, v in zip(PERSPECTIVE, values, strict=True) if p in needed)
        raise DatasetError(
            folder, f"intrinsics[{row}]: no supported camera model ({SUPPORTED}) has {values_set}"
        )
    return name


def _sizes(problem: Problem) -> Int64Array:
    """Image size of each row of intrinsics; where unknown, what just covers the observations."""
    rows = problem.intrinsics_index
    known = problem.metadata.image_sizes
    sizes = np.ones((len(problem.intrinsics), 2), dtype=np.int64)
    if known is not None:
        sizes[rows] = known
        return sizes
    largest = np.minimum(np.ceil(problem.pixels), LARGEST_COUNT).astype(np.int64)
    np.maximum.at(sizes, rows[problem.camera_index], largest)
    return sizes


def _images(
    problem: Problem, folder: Path, camera_ids: Int64Array, point_ids: Int64Array, keypoint_index: Int64Array
) -> ImageTable:
    rotations, translations = pose_from_cameras(problem.cameras)
    counts, keypoints, keypoint_points = _keypoints(problem, folder, point_ids, keypoint_index)
    return ImageTable(
        folder,
        None,
        _extra(problem, "colmap_image_ids", np.arange(1, problem.num_cameras + 1), folder),
        quaternions=quaternion_from_rotation(rotations),
        translations=translations,
        camera_ids=camera_ids[problem.intrinsics_index],
        names=_names(problem, folder),
        keypoint_counts=counts,
        keypoints=keypoints,
        keypoint_points=keypoint_points,
    )


def _names(problem: Problem, folder: Path) -> list[str]:
    names = problem.metadata.image_names or [f"image_{i:06d}" for i in range(1, problem.num_cameras + 1)]
    require_metadata_length("image_names", names, problem.num_cameras, folder)
    for name in names:
        if not name or name != name.strip() or any(c in name for c in "\0\r\n"):
            reason = "must not be empty, start or end with white space, or hold a line break or NUL"
            raise DatasetError(folder, f"image name {name!r} {reason}")
    return names


def _keypoints(
    problem: Problem, folder: Path, point_ids: Int64Array, keypoint_index: Int64Array
) -> tuple[Int64Array, FloatArray, Int64Array]:
    """Count for each image, pixels and point id (or NO_POINT) of all keypoints, image after image."""
    extra = problem.metadata.extra
    loose_image = np.asarray(extra.get("colmap_loose_image", np.empty(0, np.int64)))
    loose_index = np.asarray(extra.get("colmap_loose_keypoint_index", np.empty(0, np.int64)))
    loose_pixels = np.asarray(extra.get("colmap_loose_pixels", np.empty((0, 2))))
    image = np.concatenate([problem.camera_index, loose_image])
    index = np.concatenate([keypoint_index, loose_index])
    counts = np.bincount(image, minlength=problem.num_cameras)
    place = exclusive_sums(counts)[image] + index
    if ((index < 0) | (index >= counts[image])).any() or len(np.unique(place)) != len(place):
        raise DatasetError(
            folder, "metadata colmap_keypoint_index does not number each image's keypoints once"
        )
    pixels, ids = np.empty((len(place), 2)), np.full(len(place), NO_POINT)
    pixels[place] = np.concatenate([problem.pixels, loose_pixels])
    ids[place[: problem.num_observations]] = point_ids[problem.point_index]
    return counts, pixels, ids
