"""Tests of triangulated points, all at once: cheirality, reprojection error, angle between rays."""

from __future__ import annotations

import numpy as np

from sfmcpp.geometry._tracks import (
    camera_columns,
    in_pieces,
    intrinsics_of_observations,
    num_views,
    points_in_cameras,
    require_metric,
    require_points,
    tracks_of_one_length,
)
from sfmcpp.geometry.pinhole import pinhole_rows, to_pixels, unit
from sfmcpp.model import Problem
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.checks import require_count, require_not_negative, require_positive

# Tracks of one length are compared ray by ray in pieces of at most this many pairs of rays.
_PAIRS_AT_ONCE = 4_000_000


@checked()
def depths(problem: Problem, points: FloatArray) -> FloatArray:
    """Depth of the point of each observation in its camera; positive in front of it.

    Parameters
    ----------
    problem : Problem
        Of any metric camera model, with M observations of N points.
    points : (N, 3) float64
        World points.

    Returns
    -------
    (M,) float64
        In units of the world; not a number where the point is.
    """
    require_metric(problem)
    return points_in_cameras(problem, require_points(problem, points))[:, 2]


def projected_points(problem: Problem, points: FloatArray) -> FloatArray:
    """Image of the point of each observation.

    Parameters
    ----------
    problem : Problem
        Of any metric camera model, with M observations of N points.
    points : (N, 3) float64
        World points.

    Returns
    -------
    (M, 2) float64
        Pixels; not a number where the point is not in front of the camera or not a number.
    """
    require_metric(problem)
    in_camera = points_in_cameras(problem, require_points(problem, points))
    in_camera[~(in_camera[:, 2] > 0)] = np.nan
    return to_pixels(in_camera[:, :2] / in_camera[:, 2:], intrinsics_of_observations(problem))


@checked()
def reprojection_errors_px(problem: Problem, points: FloatArray) -> FloatArray:
    """Distance of each observation from the image of its point.

    Parameters
    ----------
    problem : Problem
        Of any metric camera model, with M observations of N points.
    points : (N, 3) float64
        World points.

    Returns
    -------
    (M,) float64
        Errors [px]; infinite where the point is not in front of the camera or not finite.
    """
    require_metric(problem)
    world = require_points(problem, points)
    errors, columns_of = np.empty(problem.num_observations), camera_columns(problem, world)
    intrinsics = np.ascontiguousarray(pinhole_rows(problem.intrinsics)[problem.intrinsics_index].T)
    for rows in in_pieces(problem):
        in_camera = columns_of(rows)
        in_front = (in_camera[2] > 0) & np.isfinite(in_camera).all(axis=0)
        in_camera[:, ~in_front] = 1.0
        lenses = intrinsics.take(problem.camera_index[rows], axis=1)
        u, v = (to_pixels((in_camera[:2] / in_camera[2]).T, lenses.T) - problem.pixels[rows]).T
        errors[rows] = np.where(in_front, np.sqrt(u * u + v * v), np.inf)
    return errors


@checked()
def mean_reprojection_errors_px(problem: Problem, points: FloatArray) -> FloatArray:
    """Mean distance of the observations of each point from its image, over the cameras it is in front of.

    Parameters
    ----------
    problem : Problem
        Of any metric camera model, with M observations of N points.
    points : (N, 3) float64
        World points.

    Returns
    -------
    (N,) float64
        Errors [px]; not a number where the point is in front of no camera that observes it.
    """
    errors = reprojection_errors_px(problem, points)
    in_front = np.isfinite(errors)
    total = np.bincount(problem.point_index, np.where(in_front, errors, 0.0), problem.num_points)
    views = np.bincount(problem.point_index, in_front, problem.num_points)
    return np.where(views > 0, total / np.maximum(views, 1), np.nan)


@checked()
def triangulation_angles_deg(problem: Problem, points: FloatArray) -> FloatArray:
    """Largest angle at each point between two cameras that observe it.

    Parameters
    ----------
    problem : Problem
        Of any metric camera model, with any number of observations of its N points.
    points : (N, 3) float64
        World points.

    Returns
    -------
    (N,) float64
        Angles [deg], 0 to 180; zero with fewer than two observations or where the point is not finite.
    """
    require_metric(problem)
    world = require_points(problem, points)
    with np.errstate(invalid="ignore"):  # points at infinity
        rays = unit(world[problem.point_index] - problem.centres[problem.camera_index])
    chords = np.zeros(problem.num_points)
    for tracks, members in tracks_of_one_length(problem, lambda length: length**2, _PAIRS_AT_ONCE):
        chords[tracks] = _longest_chords(rays[members])
    return np.asarray(np.degrees(2 * np.arcsin(np.minimum(np.nan_to_num(chords) / 2, 1.0))))


def _longest_chords(rays: FloatArray) -> FloatArray:
    """(T,) largest distance between two unit vectors of each track (T, L, 3)."""
    # The least cosine finds the pair; its chord keeps the digits that the cosine of a small angle loses.
    cosines = rays @ np.swapaxes(rays, 1, 2)
    tracks, length = rays.shape[:2]
    first, second = np.divmod(cosines.reshape(tracks, -1).argmin(axis=1), length)
    every = np.arange(tracks)
    return np.asarray(np.linalg.norm(rays[every, first] - rays[every, second], axis=1))


@checked()
def reliable_points(
    problem: Problem,
    points: FloatArray,
    *,
    max_error_px: float = 4.0,
    min_angle_deg: float = 1.0,
    min_views: int = 2,
) -> BoolArray:
    """Points in front of all their cameras, with small errors, a wide angle and enough views.

    Parameters
    ----------
    problem : Problem
        Of any metric camera model, with M observations of N points.
    points : (N, 3) float64
        World points.
    max_error_px : float
        Largest reprojection error of any observation of the point [px].
    min_angle_deg : float
        Smallest angle between the two rays that are farthest apart [deg].
    min_views : int
        Fewest observations.

    Returns
    -------
    (N,) bool

    Raises
    ------
    InvalidArgument
        If a limit is out of its range, or `points` has another shape.
    """
    require_positive("max_error_px", max_error_px)
    require_not_negative("min_angle_deg", min_angle_deg)
    require_count("min_views", min_views, 1)
    bad = reprojection_errors_px(problem, points) > max_error_px
    num_bad = np.bincount(problem.point_index, bad, problem.num_points)
    wide = triangulation_angles_deg(problem, points) >= min_angle_deg
    return np.asarray((num_bad == 0) & wide & (num_views(problem) >= min_views))
