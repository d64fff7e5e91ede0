"""Relative pose of two calibrated cameras from matches with outliers, and tests for ambiguity.

Few matches, or points near a plane or far away, can leave two poses, often tens of degrees apart, between
which the pixels hardly choose. RANSAC returns one of them; this module searches for the others as well.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.geometry._lines import pose_is_open
from sfmcpp.geometry._matches import Matches, checked_matches
from sfmcpp.geometry._poselib import RansacOptions, refined_relative_camera, relative_camera
from sfmcpp.geometry.pose_estimate import PoseEstimate, too_few, unknown_camera
from sfmcpp.geometry.so3 import rotation_angle
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.checks import require_count, require_fraction, require_positive

_SAMPLE_SIZE = 5
_CONFIDENCE = 0.9999
# Chosen on the pairs of frames 3 m apart of six KITTI drives: of 20 poses turned wrongly by more than 5° it
# names 19, at the price of refusing 60 of 482 that are right within 2°.
_LOG_LIKELIHOOD_MARGIN = 10.0
_SAME_POSE_DEG = 3.0
# Baselines of one pose with little parallax; those of the two poses that a plane leaves are farther apart.
_SAME_BASELINE_DEG = 30.0
# Part of the squared threshold that errors of exact matches are lifted to, so that likelihoods stay finite.
_EXACT = 1e-6
# Share of the matches that move less than the parallax that is told of a camera which may stand.
_LOWER = 0.25


@dataclass(frozen=True)
class RelativePose(PoseEstimate):
    """Pose of the second camera in the frame of the first, which stands at the origin.

    Attributes
    ----------
    camera, inliers, failure, message
        See :class:`PoseEstimate`.
    median_parallax_px : float
        Median over the inliers of the motion that the rotation of the pose leaves to be explained: the angle
        between the rays times the focal length [px]. Not a number without inliers.
    lower_parallax_px : float
        Lower quartile, over all matches of a pose that was found, of the motion that the rotation of most of
        them leaves [px]: as small as the noise where the camera stands, whatever moves before it.
    """

    median_parallax_px: float
    lower_parallax_px: float = np.nan


def relative_pose(
    pixels_1: ArrayLike,
    pixels_2: ArrayLike,
    intrinsics_1: ArrayLike,
    intrinsics_2: ArrayLike | None = None,
    *,
    threshold_px: float = 1.0,
    min_inliers: int = 15,
    min_inlier_ratio: float = 0.2,
    min_parallax_px: float = 2.0,
    confidence: float = _CONFIDENCE,
    max_iterations: int = 10_000,
    seed: int = 0,
) -> RelativePose:
    """Estimate a relative pose: five-point solver in adaptive LO-RANSAC, refined on the inliers (PoseLib).

    An inlier has a Sampson error of at most the threshold and its point in front of both cameras.

    Failures, named in the result:

    - ``"too few matches"``: fewer than `min_inliers`. The camera is not a number.
    - ``"rotation only"``: a rotation alone explains the matches up to a median parallax below
      `min_parallax_px`. The camera has that rotation and its centre at the origin.
    - ``"too few inliers"``: no pose agrees with enough matches. The camera is not a number.
    - ``"collinear matches"``: all inliers, or all but two, lie on one line in either image, or so near it
      that they leave the pose open. The camera is not a number.
    - ``"ambiguous"``: another pose, turned by more than 3°, fits nearly as well (see
      :func:`sfmcpp.geometry.relative_pose.best_and_rivals`). The camera is the best of them.

    Parameters
    ----------
    pixels_1, pixels_2 : (N, 2) float64
        Images of the same N points in both cameras [px].
    intrinsics_1, intrinsics_2 : (5,) float64
        ``(f, aspect, cx, cy, skew)`` of each camera, or with distortion a row of ``"perspective"`` (12,) or
        ``"bal"`` (3,); the second is the first unless given. With ``(1, 1, 0, 0, 0)`` pixels are normalised
        image points, and all lengths in px are too.
    threshold_px : float
        Largest error of an inlier [px].
    min_inliers : int
        Fewest inliers of a pose to trust, at least 5.
    min_inlier_ratio : float
        Smallest part of the matches that are inliers of a pose to trust: among many matches, more than
        `min_inliers` agree by chance.
    min_parallax_px : float
        Smallest median parallax of a pose whose translation is to be trusted [px].
    confidence : float
        Asked probability of having drawn one sample without outliers.
    max_iterations : int
        Samples at most.
    seed : int
        Same seed, same result.

    Returns
    -------
    RelativePose
        ``[R | c]`` of camera 2 with camera 1 at ``[I | 0]`` and ‖c‖ = 1.

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a number is not finite or out of its range.
    ModuleNotFoundError
        If PoseLib is not installed (extra ``vision``).
    """
    matches = checked_matches(pixels_1, pixels_2, intrinsics_1, intrinsics_2)
    require_count("min_inliers", min_inliers, _SAMPLE_SIZE)
    require_fraction("min_inlier_ratio", min_inlier_ratio)
    require_positive("min_parallax_px", min_parallax_px)
    options = RansacOptions(threshold_px, confidence, max_iterations, seed)
    if len(matches) < min_inliers:
        return _failed(matches, *too_few("matches", len(matches), min_inliers))
    rotation = matches.fit_rotation(min_parallax_px, seed)
    parallax_px = matches.parallax_px(rotation)
    # A rotation of most matches decides it at once: five points would search long for a baseline.
    still = parallax_px < min_parallax_px
    if np.count_nonzero(still) > len(matches) / 2:
        return _rotation_only_pose(rotation, still, parallax_px, min_parallax_px)
    camera = relative_camera(*matches.arrays, options)
    inliers = matches.inliers(camera, threshold_px)
    least = max(min_inliers, math.ceil(min_inlier_ratio * len(matches)))
    if np.count_nonzero(inliers) < least:
        return _failed(matches, *too_few("inliers", int(np.count_nonzero(inliers)), least))
    if np.median(parallax_px[inliers]) < min_parallax_px:
        return _rotation_only_pose(rotation, inliers, parallax_px, min_parallax_px)
    if is_open(matches, camera, inliers, threshold_px):
        reason = f"{np.count_nonzero(inliers)} inliers near one line in either image: they fit many poses"
        return _failed(matches, "collinear matches", reason)
    camera, rivals = best_and_rivals(matches, camera, rotation, options)
    lower_px = float(np.quantile(parallax_px, _LOWER))
    return replace(_successful_pose(matches, camera, rivals, threshold_px), lower_parallax_px=lower_px)


def is_open(matches: Matches, camera: FloatArray, inliers: BoolArray, threshold_px: float) -> bool:
    """Whether five or more `inliers` of a second camera lie so near one line that they leave it open."""
    chosen = matches.select(inliers)
    return pose_is_open(chosen.rays, chosen.errors_px(camera), matches.focal_px, threshold_px)


def _successful_pose(
    matches: Matches, camera: FloatArray, rivals: FloatArray, threshold_px: float
) -> RelativePose:
    inliers = matches.inliers(camera, threshold_px)
    median = float(np.median(matches.parallax_px(camera[:, :3])[inliers]))
    failure, message = ("ambiguous", ambiguity_message(camera, rivals)) if len(rivals) else ("", "")
    return RelativePose(camera, inliers, failure, message, median)


def _failed(matches: Matches, failure: str, message: str) -> RelativePose:
    return RelativePose(unknown_camera(), np.zeros(len(matches), dtype=np.bool_), failure, message, np.nan)


def _rotation_only_pose(
    rotation: FloatArray, inliers: BoolArray, parallax_px: FloatArray, min_parallax_px: float
) -> RelativePose:
    median = float(np.median(parallax_px[inliers]))
    message = f"rotation only: median parallax {median:.3g} px, must be at least {min_parallax_px:g} px"
    return RelativePose(np.column_stack([rotation, np.zeros(3)]), inliers, "rotation only", message, median)


def best_and_rivals(
    matches: Matches, camera: FloatArray, rotation: FloatArray, options: RansacOptions
) -> tuple[FloatArray, FloatArray]:
    """Refine the pose from other starts too; the best of all, and those that the matches do not rule out.

    The starts have the `rotation` that explains most matches without a baseline, and the baselines nearest
    to them then, forward, sideways and vertical, each in both senses. With truncated squared errors ``e²``
    and Gaussian noise of unknown size, the log-likelihood of a pose is ``−N/2 · log Σ e²``. A rival is less
    likely than the best by a factor of at most e¹⁰ and turned away from it by more than 3°.

    Parameters
    ----------
    matches : Matches
        All matches.
    camera : (3, 4) float64
        ``[R | c]`` of the second camera as found by RANSAC.
    rotation : (3, 3) float64
        Rotation of the second camera if it only turned.
    options : RansacOptions
        Threshold of the inliers.

    Returns
    -------
    best : (3, 4) float64
    rivals : (K, 3, 4) float64
        Empty where the pose is the only one.
    """
    inliers = matches.inliers(camera, options.threshold_px)
    chosen = matches.select(inliers).arrays
    starts = [np.column_stack([rotation, c]) for c in _baselines(matches, rotation, inliers)]
    cameras = np.stack([camera, *(refined_relative_camera(*chosen, start, options) for start in starts)])
    return likely_cameras(matches, cameras, options.threshold_px)


def likely_cameras(
    matches: Matches, cameras: FloatArray, threshold_px: float
) -> tuple[FloatArray, FloatArray]:
    """The most likely of `cameras` (K, 3, 4), and those (L, 3, 4) elsewhere that are not ruled out."""
    scores = np.array([_log_likelihood(matches, c, threshold_px) for c in cameras])
    best = int(np.argmax(scores))
    likely = scores >= scores[best] - _LOG_LIKELIHOOD_MARGIN
    return cameras[best], cameras[likely & (_rotation_angles_deg(cameras, cameras[best]) > _SAME_POSE_DEG)]


def denying_pose(
    pixels_1: FloatArray,
    pixels_2: FloatArray,
    intrinsics: FloatArray,
    camera: FloatArray,
    *,
    threshold_px: float = 1.0,
    min_parallax_px: float = 2.0,
    max_iterations: int = 10_000,
    seed: int = 0,
) -> FloatArray | None:
    """Second camera (3, 4), ‖c‖ = 1, of matches that rule `camera` (3, 4) out; None if they do not.

    A plane leaves two poses, with baselines far apart. One has a part of the plane behind it, which images
    that are near each other share, and those farther apart may not. The options are those of
    :func:`relative_pose`.
    """
    found = relative_pose(
        pixels_1,
        pixels_2,
        intrinsics,
        threshold_px=threshold_px,
        min_parallax_px=min_parallax_px,
        max_iterations=max_iterations,
        seed=seed,
    )
    if not found.success:
        return None
    matches = checked_matches(pixels_1, pixels_2, intrinsics, None)
    options = RansacOptions(threshold_px, _CONFIDENCE, max_iterations, seed)
    near = refined_relative_camera(*matches.select(found.inliers).arrays, camera, options)
    denied, right = (_log_likelihood(matches, c, threshold_px) for c in (near, found.camera))
    is_elsewhere = near[:, 3] @ found.camera[:, 3] < math.cos(math.radians(_SAME_BASELINE_DEG))
    return found.camera if is_elsewhere and right - denied > _LOG_LIKELIHOOD_MARGIN else None


def ambiguity_message(camera: FloatArray, rivals: FloatArray) -> str:
    """How far the farthest rival is turned away from the best pose."""
    farthest = _rotation_angles_deg(rivals, camera).max()
    return f"another pose, turned by {farthest:.3g} deg, fits nearly as well: must be none beyond 3 deg"


def _baselines(matches: Matches, rotation: FloatArray, inliers: BoolArray) -> FloatArray:
    """(8, 3) unit vectors; the first is across the normals of the epipolar planes of the inliers."""
    ray_1, ray_2 = matches.rays
    normals = np.cross(ray_1, ray_2 @ rotation.T)[inliers]
    linear = np.linalg.svd(normals, full_matrices=False)[2][-1]
    forward = np.vstack([linear, np.eye(3)])
    return np.vstack([forward, -forward])


def _log_likelihood(matches: Matches, camera: FloatArray, threshold_px: float) -> float:
    squares = np.minimum(matches.errors_px(camera) / threshold_px, 1.0) ** 2
    return float(-len(squares) / 2 * np.log(squares.sum() + _EXACT**2 * len(squares)))


def _rotation_angles_deg(cameras: FloatArray, camera: FloatArray) -> FloatArray:
    """(K,) angles [deg] between the rotations of `cameras` and that of `camera`."""
    return np.degrees(rotation_angle(np.swapaxes(cameras[:, :, :3], 1, 2) @ camera[:, :3]))
