"""Triangulation of tracks with outliers, all points at once.

The point that most observations of a track agree with is looked for among the midpoints of pairs of its
rays, then moved to the least squared errors of those that agree.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sfmcpp.geometry._tracks import (
    intrinsics_of_observations,
    normalised_pixels,
    observed_rays,
    require_metric,
    tracks_of_one_length,
)
from sfmcpp.geometry.epipolar import midpoints
from sfmcpp.geometry.pinhole import homogeneous
from sfmcpp.geometry.point_tests import reprojection_errors_px, triangulation_angles_deg
from sfmcpp.geometry.triangulation import refine_points
from sfmcpp.model import Problem
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.checks import require_count, require_not_negative, require_positive

# Of longer tracks as many pairs of rays are tried: with half of 50 observations wrong, all 32 miss once in
# 10⁴ tracks.
_MOST_PAIRS = 32
# Rays that are compared in one piece, at most.
_PIECE = 2_000_000
# A midpoint is not yet the best point: its inliers may be so much farther away.
_FIRST_THRESHOLD = 2.0
_NUM_REFITS, _STEPS_EACH = 2, 3


@checked()
def robust_triangulation(
    problem: Problem, *, max_error_px: float = 4.0, min_angle_deg: float = 1.0, min_views: int = 2
) -> tuple[FloatArray, BoolArray]:
    """Triangulate tracks by what most of their observations agree on.

    Candidates are the midpoints between two rays of a track: of all pairs of up to eight observations, of 32
    pairs of longer tracks. The one with the least truncated squared errors over the whole track is
    moved to the least squares of its inliers, twice.

    Parameters
    ----------
    problem : Problem
        Of any metric camera model, with M observations of N points; the points are not looked at.
    max_error_px : float
        Largest reprojection error of an inlier [px].
    min_angle_deg : float
        Smallest angle between the two rays of inliers that are farthest apart [deg].
    min_views : int
        Fewest inliers of a point, at least 2.

    Returns
    -------
    points : (N, 3) float64
        Not a number where too few observations agree, or at too narrow an angle.
    inliers : (M,) bool
        Observations that agree with their point; none of points that are not a number.

    Raises
    ------
    InvalidArgument
        If a limit is out of its range, the problem is projective, has numbers that are not finite or indices
        out of range.
    """
    require_metric(problem)
    require_positive("max_error_px", max_error_px)
    require_not_negative("min_angle_deg", min_angle_deg)
    require_count("min_views", min_views, 2)
    points = _best_midpoints(problem, max_error_px)
    inliers = _inliers(problem, points, _FIRST_THRESHOLD * max_error_px)
    for _ in range(_NUM_REFITS):
        points = refine_points(problem.with_observations(inliers), points, max_steps=_STEPS_EACH)
        inliers = _inliers(problem, points, max_error_px)
    angles = triangulation_angles_deg(problem.with_observations(inliers), points)
    good = (_num_inliers(problem, inliers) >= min_views) & (angles >= min_angle_deg)
    return np.where(good[:, None], points, np.nan), inliers & good[problem.point_index]


def _inliers(problem: Problem, points: FloatArray, max_error_px: float) -> BoolArray:
    return np.asarray(reprojection_errors_px(problem, points) <= max_error_px)


def _num_inliers(problem: Problem, inliers: BoolArray) -> NDArray[np.int64]:
    return np.bincount(problem.point_index[inliers], minlength=problem.num_points)


def _best_midpoints(problem: Problem, max_error_px: float) -> FloatArray:
    """(N, 3) midpoint of two rays of each track that agrees best with all; not a number without any."""
    points = np.full((problem.num_points, 3), np.nan)
    rays, centres = observed_rays(problem), problem.centres[problem.camera_index]
    limits = max_error_px / _px_per_rad(problem)
    for tracks, members in tracks_of_one_length(problem, _numbers_of_track, _PIECE):
        origin = centres[members].mean(axis=1)
        local = centres[members] - origin[:, None]
        points[tracks] = origin + _best_of_pairs(rays[members], local, limits[members])
    return points


def _px_per_rad(problem: Problem) -> FloatArray:
    """(M,) pixels that one radian is worth where each observation lies: the mean of all directions."""
    rows = intrinsics_of_observations(problem)
    focal = rows[:, 0] * (1 + rows[:, 1]) / 2
    # f / cos φ along circles round the axis, f / cos² φ away from it.
    away = np.linalg.norm(homogeneous(normalised_pixels(problem)), axis=1)
    return np.asarray(focal * away**1.5)


def _numbers_of_track(length: int) -> int:
    return length * len(_pairs(length)[0])


def _pairs(length: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Observations of a track of that length to begin with, two by two, far from each other first."""
    strides = sorted(range(1, length // 2 + 1), reverse=True)
    pairs = dict.fromkeys(
        (min(i, (i + stride) % length), max(i, (i + stride) % length))
        for stride in strides
        for i in range(length)
    )
    first, second = np.array(list(pairs)[:_MOST_PAIRS], dtype=np.intp).T
    return first, second


def _best_of_pairs(rays: FloatArray, centres: FloatArray, limits: FloatArray) -> FloatArray:
    """(T, 3) midpoint of two rays with the least truncated errors over all rays of its track.

    Parameters
    ----------
    rays, centres : (T, L, 3) float64
        Unit vectors and where they start.
    limits : (T, L) float64
        Errors at which they are truncated [rad].
    """
    first, second = _pairs(rays.shape[1])
    found = midpoints(rays[:, first], centres[:, first], rays[:, second], centres[:, second])
    # Of v from the centre c to the point X: v·d and ‖v‖², without an array of all v.
    # Rays that are parallel but for rounding meet at infinity: what is not a number is an error at its limit.
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        along = found @ np.swapaxes(rays, 1, 2) - (centres * rays).sum(axis=2)[:, None]
        squares = (found**2).sum(axis=2)[:, :, None] + (centres**2).sum(axis=2)[:, None]
        squares -= 2 * (found @ np.swapaxes(centres, 1, 2))
        errors = (squares / along**2 - 1) / limits[:, None] ** 2
    costs = np.where((along > 0) & (errors < 1), errors, 1.0).sum(axis=2)
    best = np.argmin(costs, axis=1)
    return np.asarray(found[np.arange(len(found)), best])
