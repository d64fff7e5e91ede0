"""Two models of one scene that share points become one."""

from __future__ import annotations

import numpy as np

from sfmcpp.geometry import Similarity, fit_similarity, reprojection_errors_px
from sfmcpp.map import Map
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sfm.settings import IncrementalSettings

_SAMPLES = 500
_SAMPLE_SIZE = 3
# Points of both models agree if they are nearer than this part of the spread of the common ones.
_NEAR = 0.02


def join(kept: Map, other: Map, settings: IncrementalSettings) -> bool:
    """Take the images of `other` into `kept`, if the points that both have say where; whether they do.

    Both are of the same scene: images, keypoints and points have the same numbers. Poses and points that
    `kept` has stay.
    """
    common = np.flatnonzero(kept.known & other.known)
    if len(common) < settings.min_inliers:
        return False
    place = robust_similarity(other.points[common], kept.points[common], settings)
    if place is None or not _fits(kept, other, place, settings):
        return False
    images = other.registered & ~kept.registered
    kept.poses[images] = place.apply_to_poses(other.poses[images])
    points = other.known & ~kept.known
    kept.points[points] = place.apply(other.points[points])
    return True


def robust_similarity(
    source: FloatArray, target: FloatArray, settings: IncrementalSettings
) -> Similarity | None:
    """Similarity of most pairs of points (n, 3), from samples of three; None if fewer than a half agree."""
    random = np.random.default_rng(settings.seed)
    spread = np.linalg.norm(target - np.median(target, axis=0), axis=1)
    near = _NEAR * float(np.median(spread))
    best = np.zeros(len(source), dtype=np.bool_)
    for _ in range(_SAMPLES):
        some = random.choice(len(source), _SAMPLE_SIZE, replace=False)
        close = _distances(_fitted(source[some], target[some]), source, target) < near
        if np.count_nonzero(close) > np.count_nonzero(best):
            best = close
    if np.count_nonzero(best) < max(settings.min_inliers, len(source) / 2):
        return None
    return fit_similarity(source[best], target[best])


def _fitted(source: FloatArray, target: FloatArray) -> Similarity | None:
    from sfmcpp.errors import InvalidArgument

    try:
        return fit_similarity(source, target)
    except InvalidArgument:
        return None


def _distances(place: Similarity | None, source: FloatArray, target: FloatArray) -> FloatArray:
    if place is None:
        return np.full(len(source), np.inf)
    return np.asarray(np.linalg.norm(place.apply(source) - target, axis=1))


def _fits(kept: Map, other: Map, place: Similarity, settings: IncrementalSettings) -> bool:
    """Whether the images of `other`, put in place, see the points of `kept` where these should be."""
    common = np.flatnonzero(kept.known & other.known)
    local = other.seen_from(other.registered, common)
    local.problem.cameras[:] = place.apply_to_poses(local.problem.cameras)
    errors = reprojection_errors_px(local.problem, kept.points[local.points])
    return bool(len(errors) and np.median(errors) <= 2 * settings.outlier_px)
