"""Wrapper of PoseLib: the only module that imports it and converts its conventions.

PoseLib's poses are camera_from_world (``x_cam = R X + t``); its relative pose takes the first camera's frame
to the second's. Its fundamental matrix has ``x₂ᵀ F x₁ = 0``, ours ``x₁ᵀ F x₂ = 0``; its homographies take
the first image to the second, as ours. Its pinhole camera has no skew: it is given pixels of an ideal camera
with square pixels and the principal point at the origin.
"""

from __future__ import annotations

import platform
import sys
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np

from sfmcpp.geometry.pinhole import mean_focal_px, to_normalised, unit
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.checks import require_count, require_fraction, require_positive, require_seed

# Fewer samples than this save no time worth having.
_MIN_ITERATIONS = 50
# Points are usually no closer together and no farther apart than this: with others, as in millimetres,
# PoseLib's steps stop short of the minimum.
_LEAST_EXTENT, _LARGEST_EXTENT = 1e-4, 1e4


@dataclass(frozen=True)
class RansacOptions:
    """How long and how strictly to search.

    Attributes
    ----------
    threshold_px : float
        Largest error of an inlier [px].
    confidence : float
        Asked probability of having drawn one sample without outliers.
    max_iterations : int
        Samples at most.
    seed : int
        Same seed, same result.
    """

    threshold_px: float
    confidence: float
    max_iterations: int
    seed: int

    def __post_init__(self) -> None:
        require_positive("threshold_px", self.threshold_px)
        require_fraction("confidence", self.confidence)
        require_count("max_iterations", self.max_iterations, 1)
        require_seed(self.seed)


def relative_camera(
    pixels_1: FloatArray,
    pixels_2: FloatArray,
    intrinsics_1: FloatArray,
    intrinsics_2: FloatArray,
    options: RansacOptions,
) -> FloatArray:
    """``[R | c]`` (3, 4) of camera 2 in the frame of camera 1, ‖c‖ = 1, by five points and RANSAC."""
    pose, _ = _load().estimate_relative_pose(
        _ideal_pixels(pixels_1, intrinsics_1),
        _ideal_pixels(pixels_2, intrinsics_2),
        _ideal_camera(intrinsics_1),
        _ideal_camera(intrinsics_2),
        _ransac("max_epipolar_error", options),
        _refinement(options),
    )
    return _with_unit_baseline(_world_from_camera(pose))


def refined_relative_camera(
    pixels_1: FloatArray,
    pixels_2: FloatArray,
    intrinsics_1: FloatArray,
    intrinsics_2: FloatArray,
    camera: FloatArray,
    options: RansacOptions,
) -> FloatArray:
    """`camera` (3, 4) as start, moved to a local minimum of the robust Sampson errors, ‖c‖ = 1."""
    start = _load().CameraPose()
    start.R, start.t = camera[:, :3].T, -camera[:, :3].T @ camera[:, 3]
    pose, _ = _load().refine_relative_pose(
        _ideal_pixels(pixels_1, intrinsics_1),
        _ideal_pixels(pixels_2, intrinsics_2),
        start,
        _ideal_camera(intrinsics_1),
        _ideal_camera(intrinsics_2),
        _refinement(options),
    )
    return _with_unit_baseline(_world_from_camera(pose))


def fundamental_by_ransac(pixels_1: FloatArray, pixels_2: FloatArray, options: RansacOptions) -> FloatArray:
    """``F`` (3, 3) of norm one by seven points and RANSAC, refined on its inliers."""
    matrix, _ = _load().estimate_fundamental(
        pixels_1, pixels_2, _ransac("max_epipolar_error", options), _refinement(options)
    )
    return _of_norm_one(np.asarray(matrix, dtype=np.float64).T)


def refined_fundamental(
    pixels_1: FloatArray, pixels_2: FloatArray, fundamental: FloatArray, options: RansacOptions
) -> FloatArray:
    """`fundamental` (3, 3) as start, moved to a local minimum of the robust Sampson errors, of norm one."""
    matrix, _ = _load().refine_fundamental(pixels_1, pixels_2, fundamental.T, _refinement(options))
    return _of_norm_one(np.asarray(matrix, dtype=np.float64).T)


def homography_by_ransac(pixels_1: FloatArray, pixels_2: FloatArray, options: RansacOptions) -> FloatArray:
    """``H`` (3, 3) of norm one from image 1 to 2 by four points and RANSAC, refined on its inliers."""
    matrix, _ = _load().estimate_homography(
        pixels_1, pixels_2, _ransac("max_reproj_error", options), _refinement(options)
    )
    return _of_norm_one(np.asarray(matrix, dtype=np.float64))


def cameras_of_homography(homography: FloatArray) -> FloatArray:
    """Second cameras ``[R | c]`` (K, 3, 4), ‖c‖ = 1, of ``x₂ ∝ H x₁`` of a plane, x at depth one."""
    poses, _ = _load().motion_from_homography(homography)
    cameras = [_with_unit_baseline(_world_from_camera(pose)) for pose in poses if np.any(pose.t)]
    return np.asarray(cameras).reshape(-1, 3, 4)


def absolute_camera(
    points: FloatArray, pixels: FloatArray, intrinsics: FloatArray, options: RansacOptions
) -> FloatArray:
    """``[R | c]`` (3, 4) of the camera that sees world `points` at `pixels`, by three points and RANSAC."""
    origin, length = working_frame(points)
    pose, _ = _load().estimate_absolute_pose(
        _ideal_pixels(pixels, intrinsics),
        (points - origin) / length,
        _ideal_camera(intrinsics),
        _ransac("max_reproj_error", options),
        _refinement(options),
    )
    camera = _world_from_camera(pose)
    return np.column_stack([camera[:, :3], origin + length * camera[:, 3]])


def working_frame(points: FloatArray) -> tuple[FloatArray, float]:
    """Origin (3,) and unit of length in which coordinates of `points` (N, 3) are neither tiny nor huge.

    The origin is among the points, so that a world that is moved gives the same camera, moved.
    """
    middle = np.asarray(np.median(points, axis=0))
    distances = np.abs(points - middle).max(axis=1)
    extent = float(np.median(distances)) or float(distances.max())
    return middle, 1.0 if _LEAST_EXTENT <= extent <= _LARGEST_EXTENT else extent


def cameras_of_four_points(points: FloatArray, images: FloatArray) -> list[tuple[FloatArray, float]]:
    """``[R | c]`` (3, 4) and focal lengths that see four `points` at `images` from the principal point."""
    poses, focals = _load().p4pf(images, points, True)
    return [(_world_from_camera(pose), float(focal)) for pose, focal in zip(poses, focals, strict=True)]


def _load() -> ModuleType:
    try:
        import poselib
    except ModuleNotFoundError as error:
        message = f"two-view geometry and resection need {error.name}: {_installation()}"
        raise ModuleNotFoundError(message, name=error.name) from None
    module: ModuleType = poselib
    return module


def _installation() -> str:
    is_linux_on_arm = sys.platform == "linux" and platform.machine() != "x86_64"
    if is_linux_on_arm or sys.version_info >= (3, 15):  # there are no wheels
        return "it must be built here, as docs/install.md has it"
    return "pip install 'sfmcpp[vision]'"


def _world_from_camera(pose: Any) -> FloatArray:
    rotation = np.asarray(pose.R, dtype=np.float64).T
    centre = -rotation @ np.asarray(pose.t, dtype=np.float64).reshape(3)
    return np.column_stack([rotation, centre])


def _with_unit_baseline(camera: FloatArray) -> FloatArray:
    return np.column_stack([camera[:, :3], unit(camera[:, 3])])


def _of_norm_one(matrix: FloatArray) -> FloatArray:
    norm = np.linalg.norm(matrix)
    return np.asarray(matrix / norm if norm > 0 else np.full((3, 3), np.nan))


def _ideal_pixels(pixels: FloatArray, intrinsics: FloatArray) -> FloatArray:
    ideal: FloatArray = mean_focal_px(intrinsics) * to_normalised(pixels, intrinsics)
    return ideal


def _ideal_camera(intrinsics: FloatArray) -> dict[str, Any]:
    params = [mean_focal_px(intrinsics), 0.0, 0.0]
    return {"model": "SIMPLE_PINHOLE", "width": 0, "height": 0, "params": params}


def _ransac(threshold: str, options: RansacOptions) -> dict[str, Any]:
    return {
        threshold: options.threshold_px,
        "success_prob": options.confidence,
        "min_iterations": min(_MIN_ITERATIONS, options.max_iterations),
        "max_iterations": options.max_iterations,
        "seed": int(options.seed),
    }


def _refinement(options: RansacOptions) -> dict[str, Any]:
    return {"loss_type": "CAUCHY", "loss_scale": options.threshold_px}
