"""From COLMAP's tables to a problem, with every cross-reference checked."""

from __future__ import annotations

import numpy as np

from sfmcpp.geometry.so3 import rotation_from_quaternion
from sfmcpp.model import Metadata, Problem
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.metadata import SECOND_SIGHTINGS, keypoint_entries
from sfmcpp.sources.io.checks import finite_rows, first_duplicate
from sfmcpp.sources.io.colmap.camera_models import (
    DIVISOR_RULE,
    FISHEYE_MODELS,
    READ_MODELS,
    has_divisor,
    intrinsics_from_params,
)
from sfmcpp.sources.io.colmap.fisheye import FISHEYE
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
from sfmcpp.sources.io.intrinsics import perspective_columns
from sfmcpp.sources.io.poses import cameras_from_pose
from sfmcpp.sources.io.rows import exclusive_sums


def problem_from_tables(tables: Tables, source_format: str) -> Problem:
    """Make the problem of a model: images become cameras, and COLMAP's cameras shared intrinsics.

    Raises
    ------
    DatasetError
        Naming the file and line, or entry, of the first reference or number that cannot be right.
    """
    cameras, images, points = tables.cameras, tables.images, tables.points
    cameras.require_unique_ids(LARGEST_ID)
    images.require_unique_ids(LARGEST_ID)
    points.require_unique_ids(LARGEST_POINT_ID)
    intrinsics_index = cameras.rows_of(images.camera_ids)
    images.require(intrinsics_index >= 0, "its camera id is not in the list of cameras")
    point, image, keypoint = _tracks(images, points)
    first, second = _first_and_further_sightings(point, image, len(images.ids))
    intrinsics, fixed = _intrinsics(cameras)
    are_fisheyes = _are_fisheyes(cameras)
    columns = perspective_columns(*FISHEYE.intrinsics) if are_fisheyes else slice(None)
    problem = Problem(
        FISHEYE if are_fisheyes else "perspective",
        _poses(images),
        intrinsics[:, columns],
        points.positions,
        image[first].astype(np.int32),
        point[first].astype(np.int32),
        images.keypoints[keypoint[first]],
        intrinsics_index=intrinsics_index.astype(np.int32),
        fixed_intrinsics=fixed[:, columns],
        metadata=_metadata(cameras, images, points, source_format),
    )
    problem.metadata.extra |= _keypoints(images, keypoint[first])
    if len(second):
        number = points.track_keypoints[second]
        problem.metadata.extra[SECOND_SIGHTINGS] = np.column_stack(
            [image[second], number, points.ids[point[second]]]
        )
    if problem.num_cameras:
        problem.metadata.image_sizes = cameras.sizes[intrinsics_index]
    return problem


def _intrinsics(cameras: CameraTable) -> tuple[FloatArray, BoolArray]:
    models = [READ_MODELS[name] for name in cameras.models]
    good = [not m.has_aspect or numbers[0] != 0 for m, numbers in zip(models, cameras.params, strict=True)]
    cameras.require(np.array(good, dtype=np.bool_), "fx must not be 0")
    whole = [not has_divisor(name, row) for name, row in zip(cameras.models, cameras.params, strict=True)]
    cameras.require(np.array(whole, dtype=np.bool_), DIVISOR_RULE)
    with np.errstate(all="ignore"):
        values, fixed = intrinsics_from_params(cameras.models, cameras.params)
    cameras.require(finite_rows(values), "the ratio of the focal lengths is not finite")
    return values, fixed


def _are_fisheyes(cameras: CameraTable) -> bool:
    """Whether all cameras have fisheye lenses; a problem has one camera model."""
    fisheye = np.array([name in FISHEYE_MODELS for name in cameras.models], dtype=np.bool_)
    first = bool(len(fisheye)) and bool(fisheye[0])
    kind = "a fisheye, too" if first else "no fisheye either"
    cameras.require(fisheye == first, f"its lens differs from the first one's: must be {kind}")
    return first


def _poses(images: ImageTable) -> FloatArray:
    images.require(np.any(images.quaternions != 0, axis=1), "the quaternion is zero")
    with np.errstate(all="ignore"):
        rotations = rotation_from_quaternion(images.quaternions)
        poses = cameras_from_pose(rotations, images.translations)
    images.require(finite_rows(poses), "the numbers of the pose are too large")
    return poses


def _tracks(images: ImageTable, points: PointTable) -> tuple[Int64Array, Int64Array, Int64Array]:
    """Point, image and keypoint row of every entry of the points' tracks."""
    point = np.repeat(np.arange(len(points.ids)), points.track_counts)
    image = images.rows_of(points.track_images)
    _require_tracks(points, point, image >= 0, "its track has an image that is not in the list of images")
    counts = images.keypoint_counts[image]
    inside = (points.track_keypoints >= 0) & (points.track_keypoints < counts)
    _require_tracks(points, point, inside, "its track has a keypoint that its image does not have")
    keypoint = exclusive_sums(images.keypoint_counts)[image] + points.track_keypoints
    same = images.keypoint_points[keypoint] == points.ids[point]
    _require_tracks(points, point, same, "its track has a keypoint that the image gives to another point")
    _require_single(points, point, image, keypoint)
    _require_all_entries(images, keypoint)
    return point, image, keypoint


def _first_and_further_sightings(
    point: Int64Array, image: Int64Array, num_images: int
) -> tuple[Int64Array, Int64Array]:
    """Entries of the tracks by which an image sees a point first, and the others, both in their order."""
    entries = np.arange(len(point))
    if first_duplicate(image, point, num_images) is None:
        return entries, entries[:0]
    _, first = np.unique(point * num_images + image, return_index=True)
    return np.sort(first), np.delete(entries, first)


def _require_tracks(points: PointTable, point: Int64Array, good: BoolArray, reason: str) -> None:
    if not good.all():
        raise points.error(int(point[np.argmin(good)]), reason)


def _require_single(points: PointTable, point: Int64Array, image: Int64Array, keypoint: Int64Array) -> None:
    duplicate = first_duplicate(keypoint, point, int(keypoint.max(initial=0)) + 1)
    if duplicate is not None:
        track_image, number = points.track_images[duplicate[1]], points.track_keypoints[duplicate[1]]
        reason = f"image {track_image} observes this point twice by its keypoint {number}"
        raise points.error(int(point[duplicate[1]]), reason)


def _require_all_entries(images: ImageTable, keypoint: Int64Array) -> None:
    loose = images.keypoint_points == NO_POINT
    loose[keypoint] = True
    if not loose.all():
        row = int(np.argmin(loose))
        image = int(np.searchsorted(np.cumsum(images.keypoint_counts), row, side="right"))
        raise images.error(image, f"keypoint of point {images.keypoint_points[row]}, which does not list it")


def _keypoints(images: ImageTable, keypoint: Int64Array) -> dict[str, object]:
    counts = images.keypoint_counts
    number = np.arange(len(images.keypoints)) - np.repeat(exclusive_sums(counts), counts)
    is_loose = np.ones(len(number), dtype=np.bool_)
    is_loose[keypoint] = False
    loose = np.flatnonzero(is_loose)
    image = np.searchsorted(np.cumsum(counts), loose, side="right")
    return keypoint_entries(number[keypoint], image, number[loose], images.keypoints[loose])


def _metadata(cameras: CameraTable, images: ImageTable, points: PointTable, source_format: str) -> Metadata:
    return Metadata(
        source_format=source_format,
        image_names=images.names,
        point_colors=points.colors,
        extra={
            "colmap_camera_ids": cameras.ids,
            "colmap_camera_models": cameras.models,
            "colmap_camera_sizes": cameras.sizes,
            "colmap_image_ids": images.ids,
            "colmap_point_ids": points.ids,
        },
    )
