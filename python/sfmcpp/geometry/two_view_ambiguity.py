"""Other relative poses that fit as well.

Few matches, or points near a plane or far away, can leave two poses, often tens of degrees apart, between
which the pixels hardly choose. RANSAC returns one of them without a word; this module looks for the others.
"""

from __future__ import annotations

import numpy as np

from sfmcpp.geometry._matches import Matches
from sfmcpp.geometry._poselib import RansacOptions, refined_relative_camera
from sfmcpp.geometry.so3 import rotation_angle
from sfmcpp.model.arrays import BoolArray, FloatArray

# Chosen on the pairs of frames 3 m apart of six KITTI drives: of 20 poses turned wrongly by more than 5° it
# names 19, at the price of refusing 60 of 482 that are right within 2°.
_LOG_LIKELIHOOD_MARGIN = 10.0
_SAME_POSE_DEG = 3.0
# Part of the squared threshold that errors of exact matches are lifted to, so that likelihoods stay finite.
_EXACT = 1e-6


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
    return cameras[best], cameras[likely & (_turns_deg(cameras, cameras[best]) > _SAME_POSE_DEG)]


def ambiguity_message(camera: FloatArray, rivals: FloatArray) -> str:
    """How far the farthest rival is turned away from the best pose."""
    farthest = _turns_deg(rivals, camera).max()
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


def _turns_deg(cameras: FloatArray, camera: FloatArray) -> FloatArray:
    """(K,) angles [deg] between the rotations of `cameras` and that of `camera`."""
    return np.degrees(rotation_angle(np.swapaxes(cameras[:, :, :3], 1, 2) @ camera[:, :3]))
