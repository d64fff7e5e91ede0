"""Two models of one scene that share points become one."""

from __future__ import annotations

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import Similarity, agreeing_pairs, fit_similarity, reprojection_errors_px
from sfmcpp.map import Map
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sfm.settings import IncrementalSettings

# Points of both models agree if most are nearer than this part of the spread of the common ones.
_NEAR = 0.02


def join(kept: Map, other: Map, settings: IncrementalSettings) -> bool:
    """Take the images of `other` into `kept`, if the points that both have say where; whether they do.

    Both are of the same scene: images, keypoints and points have the same numbers. Poses and points that
    `kept` has stay.
    """
    common = np.flatnonzero(kept.known & other.known)
    if len(common) < settings.min_inliers:
        return False
    place = _placed(other.points[common], kept.points[common], settings)
    if place is None or not _fits(kept, other, place, settings):
        return False
    images = other.registered & ~kept.registered
    kept.poses[images] = place.apply_to_poses(other.poses[images])
    points = other.known & ~kept.known
    kept.points[points] = place.apply(other.points[points])
    return True


def _placed(source: FloatArray, target: FloatArray, settings: IncrementalSettings) -> Similarity | None:
    """Similarity that brings most points (n, 3) near to where they should be; None if there is none."""
    good = agreeing_pairs(source, target, seed=settings.seed)
    try:
        place = fit_similarity(source[good], target[good])
    except InvalidArgument:
        return None
    spread = np.linalg.norm(target - np.median(target, axis=0), axis=1)
    apart = np.linalg.norm(place.apply(source) - target, axis=1)
    return place if np.median(apart) < _NEAR * np.median(spread) else None


def _fits(kept: Map, other: Map, place: Similarity, settings: IncrementalSettings) -> bool:
    """Whether the images of `other`, put in place, see the points of `kept` where these should be."""
    common = np.flatnonzero(kept.known & other.known)
    local = other.seen_from(other.registered, common)
    local.problem.cameras[:] = place.apply_to_poses(local.problem.cameras)
    errors = reprojection_errors_px(local.problem, kept.points[local.points])
    return bool(len(errors) and np.median(errors) <= 2 * settings.outlier_px)
