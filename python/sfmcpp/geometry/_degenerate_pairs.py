"""Degenerate pairs, which one homography explains: identical photos, pure rotation, or a plane."""

from __future__ import annotations

import numpy as np

from sfmcpp.geometry._matches import Matches
from sfmcpp.geometry._poselib import (
    RansacOptions,
    cameras_of_homography,
    homography_by_ransac,
    refined_relative_camera,
)
from sfmcpp.geometry.relative_pose import likely_cameras
from sfmcpp.geometry.rotation_fit import refit_rotation
from sfmcpp.geometry.significance import chance_near_line, least_significant
from sfmcpp.geometry.so3 import nearest_rotation
from sfmcpp.geometry.two_view_matrices import (
    FOUR_POINTS,
    homography_errors_px,
    normalised_homography,
    with_sample_limit,
)
from sfmcpp.model.arrays import BoolArray, FloatArray

# A homography explains two components of noise where epipolar geometry explains one: with Gaussian noise it
# has the same share of inliers at this much larger a threshold (95 %: √(5.99 / 3.84)).
_TWO_COMPONENTS = 1.25
# Part of the inliers that must agree with the larger model alone.
_LEAST_PART = 0.1
# Homographies that explain a smaller part of the inliers are not looked for.
_LEAST_FLAT_PART = 0.5
# Sample of the direction of a translation, or of an epipole: what a match adds to a homography or rotation.
_DIRECTION = 2

# Photos are the same where this part of the matches, at least, moves by no more than so much.
_SAME_PART, _SAME_PX = 0.8, 0.5


def unmoved_matches(pixels_1: FloatArray, pixels_2: FloatArray) -> BoolArray | None:
    """Matches that stay where they are, if they are so many that the photos must be the same."""
    still = np.asarray(np.linalg.norm(pixels_2 - pixels_1, axis=1) <= _SAME_PX)
    return still if np.count_nonzero(still) >= _SAME_PART * len(still) else None


def homography_of_inliers(matches: Matches, inliers: BoolArray, options: RansacOptions) -> FloatArray:
    """Homography (3, 3) that most of the inliers of an epipolar geometry agree with."""
    search = with_sample_limit(options, _LEAST_FLAT_PART, FOUR_POINTS)
    return homography_by_ransac(matches.pixels_1[inliers], matches.pixels_2[inliers], search)


def homography_inliers(matches: Matches, homography: FloatArray, threshold_px: float) -> BoolArray:
    """(N,) matches that a homography explains."""
    lenses = matches.slopes_1, matches.slopes_2
    errors = homography_errors_px(homography, matches.pixels_1, matches.pixels_2, *lenses)
    return np.asarray(errors <= _TWO_COMPONENTS * threshold_px)


def rotation_inliers(matches: Matches, rotation: FloatArray, threshold_px: float) -> BoolArray:
    """(N,) matches that a rotation explains."""
    return np.asarray(matches.parallax_px(rotation) <= _rotation_limit_px(threshold_px))


def is_explained_by_smaller_model(
    matches: Matches, inliers: BoolArray, explained: BoolArray, threshold_px: float
) -> bool:
    """Whether the `inliers` of a larger model that a smaller one does not explain are few or chance."""
    beyond = np.count_nonzero(inliers & ~explained)
    chance = chance_near_line(matches.pixels_1, matches.pixels_2, threshold_px)
    by_chance = least_significant(int(np.count_nonzero(~explained)), _DIRECTION, chance)
    return bool(beyond < max(_LEAST_PART * np.count_nonzero(inliers), by_chance))


def rotation_of_homography(
    matches: Matches, flat: BoolArray, homography: FloatArray, threshold_px: float
) -> FloatArray:
    """Rotation (3, 3) of the second camera nearest to a homography, then to the matches it explains."""
    between = normalised_homography(homography, matches.intrinsics_1, matches.intrinsics_2)
    nearest = nearest_rotation(between.T * np.sign(np.linalg.det(between)))
    limit = _rotation_limit_px(threshold_px) / matches.focal_px
    return refit_rotation(*matches.select(flat).rays, nearest, limit)


def cameras_of_plane(
    matches: Matches, inliers: BoolArray, homography: FloatArray, camera: FloatArray, options: RansacOptions
) -> tuple[FloatArray, FloatArray]:
    """Best second camera (3, 4) that sees the plane of a homography, and others (K, 3, 4) as likely.

    Up to two have a plane in front of them; points off the plane, if any, choose.
    """
    between = normalised_homography(homography, matches.intrinsics_1, matches.intrinsics_2)
    chosen = matches.select(inliers)
    starts = [camera, *cameras_of_homography(between)]
    count = [np.count_nonzero(chosen.inliers(start, 2 * options.threshold_px)) for start in starts]
    good = [start for start, n in zip(starts, count, strict=True) if n >= max(count) / 2]
    refined = np.stack([refined_relative_camera(*chosen.arrays, start, options) for start in good])
    return likely_cameras(matches, refined, options.threshold_px)


def _rotation_limit_px(threshold_px: float) -> float:
    """Largest parallax of what a rotation explains."""
    # Parallax is seen in one image: √2 of its length in the joint space of both.
    return float(np.sqrt(2) * _TWO_COMPONENTS * threshold_px)
