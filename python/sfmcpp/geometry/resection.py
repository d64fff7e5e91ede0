"""Resection: pose of a calibrated camera from world points, with outliers."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.geometry._lines import turn_is_open
from sfmcpp.geometry._poselib import RansacOptions, absolute_camera
from sfmcpp.geometry.pinhole import intrinsics_row, mean_focal_px, to_pixels
from sfmcpp.geometry.pose_estimate import PoseEstimate, failed_pose, pose_with_inliers, too_few
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import ANY, BoolArray, FloatArray, finite_array
from sfmcpp.model.checks import require_count, require_fraction

_SAMPLE_SIZE = 3
# Second spread of points over the first, below which they lie on a line.
_COLLINEAR_RATIO = 1e-6


def resection(
    points: ArrayLike,
    pixels: ArrayLike,
    intrinsics: ArrayLike,
    *,
    threshold_px: float = 3.0,
    min_inliers: int = 10,
    min_inlier_ratio: float = 0.2,
    confidence: float = 0.9999,
    max_iterations: int = 10_000,
    seed: int = 0,
) -> PoseEstimate:
    """Estimate an absolute pose: three-point solver in adaptive LO-RANSAC, refined on the inliers (PoseLib).

    An inlier has a reprojection error of at most the threshold and lies in front of the camera.

    Failures, named in the result, all with a camera that is not a number:

    - ``"too few matches"``: fewer than `min_inliers`.
    - ``"collinear points"``: all points that the pose explains, or all but one, lie on a line or so near it
      that the camera may turn round it by more than 3° (one standard deviation).
    - ``"too few inliers"``: no pose agrees with enough matches.

    Parameters
    ----------
    points : (N, 3) float64
        World points.
    pixels : (N, 2) float64
        Their images [px].
    intrinsics : (5,) float64
        ``(f, aspect, cx, cy, skew)``, or with distortion a row of ``"perspective"`` (12,) or ``"bal"`` (3,).
        With ``(1, 1, 0, 0, 0)`` pixels are normalised image points, and the threshold is one too.
    threshold_px : float
        Largest reprojection error of an inlier [px] (thesis §5.3: about 3).
    min_inliers : int
        Fewest inliers of a pose to trust, at least 4.
    min_inlier_ratio : float
        Smallest part of the matches that are inliers of a pose to trust.
    confidence : float
        Asked probability of having drawn one sample without outliers.
    max_iterations : int
        Samples at most.
    seed : int
        Same seed, same result.

    Returns
    -------
    PoseEstimate
        ``[R | c]``, world_from_camera.

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a number is not finite or out of its range.
    ModuleNotFoundError
        If PoseLib is not installed (extra ``vision``).
    """
    world = finite_array("points", points, (-1, 3))
    images = finite_array("pixels", pixels, (len(world), 2))
    row = intrinsics_row("intrinsics", intrinsics)
    require_count("min_inliers", min_inliers, _SAMPLE_SIZE + 1)
    require_fraction("min_inlier_ratio", min_inlier_ratio)
    options = RansacOptions(threshold_px, confidence, max_iterations, seed)
    if len(world) < min_inliers:
        return failed_pose(len(world), *too_few("matches", len(world), min_inliers))
    if are_collinear(world):
        reason = f"{len(world)} points on one line: the camera may turn round it"
        return failed_pose(len(world), "collinear points", reason)
    camera = absolute_camera(world, images, row, options)
    inliers = pose_inliers(camera, world, images, row, threshold_px)
    least = max(min_inliers, math.ceil(min_inlier_ratio * len(world)))
    if np.count_nonzero(inliers) >= least and _may_turn(
        camera, world[inliers], images[inliers], row, threshold_px
    ):
        reason = f"{np.count_nonzero(inliers)} inliers near one line: the camera may turn round it"
        return failed_pose(len(world), "collinear points", reason)
    return pose_with_inliers(camera, inliers, least)


def _may_turn(
    camera: FloatArray, points: FloatArray, pixels: FloatArray, row: FloatArray, threshold_px: float
) -> bool:
    """Whether the inliers of a pose lie so near one line that it is open."""
    x, y, depth = ((points - camera[:, 3]) @ camera[:, :3]).T
    errors_px = np.linalg.norm(to_pixels(np.column_stack([x, y]) / depth[:, None], row) - pixels, axis=1)
    return turn_is_open(points, depth, errors_px, mean_focal_px(row), threshold_px)


@checked(camera=(3, 4), points=("n", 3), pixels=("n", 2), intrinsics=(ANY,))
def pose_inliers(
    camera: FloatArray, points: FloatArray, pixels: FloatArray, intrinsics: FloatArray, threshold_px: float
) -> BoolArray:
    """Which points a pose explains: in front of it, and seen within the threshold of where they should be.

    Parameters
    ----------
    camera : (3, 4) float64
        ``[R | c]``, world_from_camera.
    points : (N, 3) float64
        World points.
    pixels : (N, 2) float64
        Their images [px].
    intrinsics : (5,) or (12,) float64
        ``(f, aspect, cx, cy, skew)``, and the distortion if there is any.
    threshold_px : float
        Largest reprojection error of an inlier [px].

    Returns
    -------
    (N,) bool
    """
    intrinsics = intrinsics_row("intrinsics", intrinsics)
    with np.errstate(invalid="ignore"):  # points at infinity
        x, y, depth = ((points - camera[:, 3]) @ camera[:, :3]).T
    in_front = depth > 0
    depth = np.where(in_front, depth, 1.0)
    offset_px = to_pixels(np.column_stack([x / depth, y / depth]), intrinsics) - pixels
    return np.asarray(in_front & (np.linalg.norm(offset_px, axis=1) <= threshold_px))


def are_collinear(points: FloatArray) -> bool:
    """Whether all world points (N, 3) lie on one line."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] <= _COLLINEAR_RATIO * spread[0])
