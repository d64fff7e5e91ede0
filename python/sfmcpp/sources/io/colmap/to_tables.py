"""From a problem to COLMAP's tables, with identifiers and models from the metadata where known.

Points that an image sees by several keypoints: COLMAP's tracks may hold that, observations may not. SIFT
gives one corner several orientations, and each becomes a keypoint. The first in the track is the
observation; the others become keypoints without a point, are remembered, and put back on writing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.geometry import mean_reprojection_errors_px
from sfmcpp.geometry.so3 import quaternion_from_rotation
from sfmcpp.model import Problem
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.camera_models import PERSPECTIVE
from sfmcpp.model.metadata import KEYPOINTS, LOOSE, SECOND_SIGHTINGS
from sfmcpp.sources.io.checks import (
    LARGEST_COUNT,
    fault_of_image_name,
    finite_rows,
    image_names,
    point_colors,
    require_metadata_length,
    require_valid,
)
from sfmcpp.sources.io.colmap.camera_models import (
    ColmapModel,
    held_by,
    models_of,
    params_from_intrinsics,
)
from sfmcpp.sources.io.colmap.fisheye import errors_px, is_fisheye
from sfmcpp.sources.io.colmap.tables import (
    LARGEST_ID,
    LARGEST_POINT_ID,
    NO_POINT,
    CameraTable,
    ImageTable,
    Int64Array,
    PointTable,
    Tables,
    rows_of_ids,
)
from sfmcpp.sources.io.intrinsics import (
    CornerLenses,
    as_perspective,
    lenses_from_corner,
    model_of_row,
    needed_parameters,
    no_model,
)
from sfmcpp.sources.io.poses import pose_from_cameras
from sfmcpp.sources.io.rows import all_keypoints, by_point, exclusive_sums

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
    lenses = lenses_from_corner(problem, folder)
    cameras = _cameras(problem, lenses, folder)
    point_ids = _metadata_entry(problem, "colmap_point_ids", np.arange(1, problem.num_points + 1), folder)
    problem = with_second_sightings(problem, point_ids)
    images, keypoint_index = _images(problem, folder, lenses, cameras.ids, point_ids)
    order, counts = by_point(problem)
    with np.errstate(all="ignore"):
        errors = _errors_of_points(problem)
    points = PointTable(
        folder,
        None,
        point_ids,
        positions=problem.points,
        colors=point_colors(problem, (0, 0, 0), folder),
        errors=np.where(np.isfinite(errors), errors, _UNKNOWN_ERROR),
        track_counts=counts,
        track_images=images.ids.take(problem.camera_index[order]),
        track_keypoints=keypoint_index[order],
    )
    tables = Tables(cameras, images, points)
    _require_readable(tables)
    return tables


def _errors_of_points(problem: Problem) -> FloatArray:
    """Mean reprojection errors (N,) [px]; not a number where none is known."""
    if not is_fisheye(problem):
        return mean_reprojection_errors_px(problem, problem.points)
    views = np.bincount(problem.point_index, minlength=problem.num_points)
    return np.bincount(problem.point_index, errors_px(problem), problem.num_points) / views


def _require_readable(tables: Tables) -> None:
    """Refuse identifiers, sizes and numbers from the metadata that no reader would accept."""
    cameras, images, points = tables.cameras, tables.images, tables.points
    cameras.require_unique_ids(LARGEST_ID)
    images.require_unique_ids(LARGEST_ID)
    points.require_unique_ids(LARGEST_POINT_ID)
    sizes = (cameras.sizes >= 0) & (cameras.sizes <= LARGEST_COUNT)
    cameras.require(np.asarray(sizes.all(axis=1)), f"its image size must be from 0 to {LARGEST_COUNT}")
    images.require(_finite_keypoints(images), "one of its keypoints is not finite")


def _finite_keypoints(images: ImageTable) -> BoolArray:
    good = finite_rows(images.keypoints)
    bad = np.searchsorted(np.cumsum(images.keypoint_counts), np.flatnonzero(~good), side="right")
    return np.asarray(np.bincount(bad, minlength=len(images.ids)) == 0)


def _metadata_entry(problem: Problem, key: str, default: NDArray[Any], folder: Path) -> NDArray[Any]:
    value = problem.metadata.extra.get(key)
    if value is None:
        return default
    require_metadata_length(key, value, len(default), folder)
    return np.asarray(value)


def _cameras(problem: Problem, lenses: CornerLenses, folder: Path) -> CameraTable:
    values, fixed = lenses.values, lenses.fixed
    models = _models(problem, values, fixed, folder)
    return CameraTable(
        folder,
        None,
        _metadata_entry(problem, "colmap_camera_ids", np.arange(1, len(values) + 1), folder),
        models=models,
        sizes=lenses.sizes,
        params=[params_from_intrinsics(name, row) for name, row in zip(models, values, strict=True)],
    )


def changed_models(problem: Problem, folder: Path) -> list[tuple[str, str]]:
    """The models that cameras came with and those that they are written with, where these differ."""
    names = problem.metadata.extra.get("colmap_camera_models", ())
    written = _models(problem, *as_perspective(problem), folder)
    return sorted({(old, new) for old, new in zip(names, written, strict=False) if old and old != new})


def _models(problem: Problem, values: FloatArray, fixed: BoolArray, folder: Path) -> list[str]:
    names = problem.metadata.extra.get("colmap_camera_models")
    if names is None:
        names = [""] * len(values)
    require_metadata_length("colmap_camera_models", names, len(values), folder)
    models = models_of(problem)
    held = held_by(models)
    rows = enumerate(zip(names, values, fixed, strict=True))
    return [_model(models, held, row, *columns, folder) for row, columns in rows]


def _model(
    models: Mapping[str, ColmapModel],
    held: Mapping[str, tuple[str, ...]],
    row: int,
    known: str,
    values: FloatArray,
    fixed: BoolArray,
    folder: Path,
) -> str:
    """Choose the model the row came with if it still holds its values, else the smallest that does."""
    if known in held and needed_parameters(values) <= set(held[known]):
        return known
    name = model_of_row(row, held, values, fixed, folder)
    if models[name].has_aspect and values[PERSPECTIVE.index("f")] == 0:
        raise no_model(row, held, values, folder)
    return name


def _images(
    problem: Problem, folder: Path, lenses: CornerLenses, camera_ids: Int64Array, point_ids: Int64Array
) -> tuple[ImageTable, Int64Array]:
    """Table of the images, and the number of each observation's keypoint within its image."""
    rotations, translations = pose_from_cameras(problem.cameras)
    try:
        counts, keypoints, rows = all_keypoints(problem)
    except InvalidArgument as error:
        raise DatasetError(folder, str(error)) from error
    keypoints += np.repeat(lenses.origin[problem.intrinsics_index], counts, axis=0)
    keypoint_points = np.full(len(keypoints), NO_POINT)
    keypoint_points[rows] = point_ids.take(problem.point_index)
    images = ImageTable(
        folder,
        None,
        _metadata_entry(problem, "colmap_image_ids", np.arange(1, problem.num_cameras + 1), folder),
        quaternions=quaternion_from_rotation(rotations),
        translations=translations,
        camera_ids=camera_ids[problem.intrinsics_index],
        names=_names(problem, folder),
        keypoint_counts=counts,
        keypoints=keypoints,
        keypoint_points=keypoint_points,
    )
    return images, rows - exclusive_sums(counts).take(problem.camera_index)


def _names(problem: Problem, folder: Path) -> list[str]:
    names = image_names(problem, folder)
    for name in names:
        if (fault := fault_of_image_name(name)) is not None:
            raise DatasetError(folder, f"image name {name!r} {fault}")
    return names


def with_second_sightings(problem: Problem, point_ids: Int64Array) -> Problem:
    """The problem as COLMAP has it: every sighting an observation, the second ones last.

    A second sighting goes with the first: where that is no observation any more, or the point or the keypoint
    is gone, it is left out.
    """
    extra = problem.metadata.extra
    if any(name not in extra for name in (SECOND_SIGHTINGS, KEYPOINTS, *LOOSE)):
        return problem
    cameras, numbers, ids = np.asarray(extra[SECOND_SIGHTINGS]).T
    images, loose_numbers, pixels = (np.asarray(extra[name]) for name in LOOSE)
    rows = rows_of_ids(_pair_keys(images, loose_numbers), _pair_keys(cameras, numbers))
    points = rows_of_ids(point_ids, ids)
    observed = np.isin(_pair_keys(cameras, points), _pair_keys(problem.camera_index, problem.point_index))
    kept = (rows >= 0) & observed
    loose = np.delete(np.arange(len(images)), rows[kept])
    restored = {name: np.asarray(extra[name])[loose] for name in LOOSE}
    restored[KEYPOINTS] = np.concatenate([extra[KEYPOINTS], numbers[kept]])
    return replace(
        problem,
        camera_index=np.concatenate([problem.camera_index, cameras[kept]]),
        point_index=np.concatenate([problem.point_index, points[kept]]),
        pixels=np.concatenate([problem.pixels, pixels[rows[kept]]]),
        sigma_px=None,
        covariance_px2=None,
        metadata=replace(problem.metadata, extra=extra | restored),
    )


def _pair_keys(first: NDArray[Any], second: NDArray[Any]) -> Int64Array:
    """One number for each pair of numbers; a second of −1 is no other pair's."""
    return np.asarray(first.astype(np.int64) * (LARGEST_COUNT + 2) + second)
