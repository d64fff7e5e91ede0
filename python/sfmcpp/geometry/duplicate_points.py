"""Duplicate points: several tracks of one scene point, found and merged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sfmcpp.geometry._tracks import (
    intrinsics_of_observations,
    num_views,
    observed_rays,
    require_metric,
    require_points,
)
from sfmcpp.geometry.point_tests import depths, reprojection_errors_px
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray, IndexArray, largest_of_each
from sfmcpp.model.checks import require_positive

Pairs = NDArray[np.intp]

# How far apart two positions of one point may lie, in tolerances: along the rays they are known less well.
_ALONG_RAY = 3.0


def duplicate_points(
    problem: Problem, points: FloatArray, *, tolerance_px: float, max_angle_deg: float = 30.0
) -> Pairs:
    """Find pairs of points that may be one: either lies where the other is observed.

    Parameters
    ----------
    problem : Problem
        Of any metric camera model, with M observations of N points.
    points : (N, 3) float64
        World points; those that are not a number have no duplicates.
    tolerance_px : float
        Largest reprojection error of either point at any observation of the other [px].
    max_angle_deg : float
        Largest angle between the rays of the two that are nearest in direction: a point on the other side of
        a thin body is another [deg].

    Returns
    -------
    (k, 2) int
        Numbers of the points, the smaller first; pairs of the least error first. No image observes both. A
        point may be in several pairs.

    Raises
    ------
    InvalidArgument
        If a limit is not positive, the problem is projective, or `points` has another shape.
    """
    require_metric(problem)
    require_positive("tolerance_px", tolerance_px)
    require_positive("max_angle_deg", max_angle_deg)
    world = require_points(problem, points)
    pairs = _nearby_pairs(problem, world, _ALONG_RAY * tolerance_px)
    pairs = pairs[~_seen_together(problem, pairs)]
    errors = np.maximum(
        _largest_errors_px(problem, world, pairs), _largest_errors_px(problem, world, pairs[:, ::-1])
    )
    pairs, errors = pairs[errors <= tolerance_px], errors[errors <= tolerance_px]
    kept = np.flatnonzero(_nearest_cosines(problem, pairs) >= np.cos(np.radians(max_angle_deg)))
    return pairs[kept[np.argsort(errors[kept], kind="stable")]]


def merged_tracks(problem: Problem, pairs: Pairs) -> IndexArray:
    """Merge points into one, pair after pair, where no image would observe the result twice.

    Parameters
    ----------
    problem : Problem
        With M observations of N points.
    pairs : (k, 2) int
        Numbers of points; those at the front come first.

    Returns
    -------
    (M,) int32
        Point of each observation: of those merged the one with the least number.
    """
    images = {int(p): set[int]() for p in np.unique(pairs)}
    concerned = np.isin(problem.point_index, pairs)
    seen = zip(problem.point_index[concerned].tolist(), problem.camera_index[concerned].tolist(), strict=True)
    for point, camera in seen:
        images[point].add(camera)
    root = np.arange(problem.num_points)
    for pair in pairs:
        a, b = sorted(_root(root, int(point)) for point in pair)
        if a != b and images[a].isdisjoint(images[b]):
            root[b] = a
            images[a] |= images[b]
    for point in images:
        root[point] = _root(root, point)
    return np.asarray(root[problem.point_index], dtype=np.int32)


def _root(root: NDArray[np.intp], point: int) -> int:
    while root[point] != point:
        point = int(root[point])
    return point


def _nearby_pairs(problem: Problem, points: FloatArray, radius_px: float) -> Pairs:
    """(k, 2) pairs of points nearer to each other than so many pixels, at the nearer camera of either."""
    from scipy.spatial import cKDTree

    focals = intrinsics_of_observations(problem)[:, 0]
    sizes = np.full(problem.num_points, np.inf)
    np.minimum.at(sizes, problem.point_index, depths(problem, points) / focals)
    known = np.flatnonzero(np.isfinite(points[:, 0]) & np.isfinite(sizes) & (sizes > 0))
    if len(known) < 2:
        return np.zeros((0, 2), dtype=np.intp)
    tree = cKDTree(points[known])
    found = tree.query_ball_point(points[known], radius_px * sizes[known], return_sorted=True)
    first = np.repeat(np.arange(len(known)), [len(near) for near in found])
    second = np.concatenate([np.asarray(near, dtype=np.intp) for near in found])
    pairs = np.unique(np.sort(np.stack([first, second], axis=1), axis=1), axis=0)
    return np.asarray(known[pairs[pairs[:, 0] < pairs[:, 1]]])


def _observations(problem: Problem, points: Pairs) -> tuple[Pairs, Pairs]:
    """Observations of each of `points` (k,), one after the other, and which of the k each is of."""
    order = np.argsort(problem.point_index, kind="stable")
    views = num_views(problem)
    begin = np.cumsum(views) - views
    counts = views[points]
    owner = np.repeat(np.arange(len(points)), counts)
    inside = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    return np.asarray(order[begin[points][owner] + inside]), np.asarray(owner)


def _seen_together(problem: Problem, pairs: Pairs) -> NDArray[np.bool_]:
    """(k,) whether an image observes both points of a pair."""
    first, second = (
        np.unique(owner * problem.num_cameras + problem.camera_index[rows])
        for rows, owner in (_observations(problem, pairs[:, side]) for side in (0, 1))
    )
    both = np.intersect1d(first, second) // problem.num_cameras
    together = np.zeros(len(pairs), dtype=np.bool_)
    together[both] = True
    return together


def _nearest_cosines(problem: Problem, pairs: Pairs) -> FloatArray:
    """(k,) cosine between the rays of the two points of a pair that are nearest in direction."""
    rays = observed_rays(problem)
    rows, owner = _observations(problem, pairs[:, 0])
    others, of_row = _observations(problem, pairs[owner, 1])
    cosines = (rays[rows[of_row]] * rays[others]).sum(axis=1)
    return largest_of_each(owner[of_row], cosines, len(pairs), least=-1.0)


def _largest_errors_px(problem: Problem, points: FloatArray, pairs: Pairs) -> FloatArray:
    """(k,) largest error of the first point of each pair at the observations of the second [px]."""
    rows, owner = _observations(problem, pairs[:, 1])
    swapped = replace(
        problem,
        camera_index=problem.camera_index[rows],
        point_index=pairs[owner, 0].astype(np.int32),
        pixels=problem.pixels[rows],
        sigma_px=None,
        covariance_px2=None,
    )
    return largest_of_each(owner, reprojection_errors_px(swapped, points), len(pairs))
