"""Local planes through neighbouring points: normals, and their slopes in images."""

from __future__ import annotations

import numpy as np

from sfmcpp.geometry._tracks import intrinsics_of_observations, points_in_cameras, require_points
from sfmcpp.geometry.pinhole import image_slopes, unit
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray

# Points that a plane is fitted to, and how flat they must be: variance across over the smaller one along.
_NEIGHBOURS = 12
_FLATNESS = 0.1
# Cosine of the angle at which a surface may be looked at.
_LEAST_COSINE = 0.3


def surface_normals(points: FloatArray, towards: FloatArray) -> FloatArray:
    """Normals of the surface that points are samples of.

    Parameters
    ----------
    points : (N, 3) float64
        World points.
    towards : (N, 3) float64
        Unit vectors from each to those who see it.

    Returns
    -------
    (N, 3) float64
        Unit normals on the side of `towards`, of the planes through the nearest points; `towards` itself
        where these are no plane, or one that is seen from the side.
    """
    from scipy.spatial import cKDTree

    if len(points) < _NEIGHBOURS:
        return np.array(towards)
    _, nearest = cKDTree(points).query(points, k=_NEIGHBOURS)
    around = points[nearest] - points[nearest].mean(axis=1, keepdims=True)
    variances, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", around, around))
    cosines = (axes[:, :, 0] * towards).sum(axis=1)
    normals = axes[:, :, 0] * np.where(cosines < 0, -1.0, 1.0)[:, None]
    is_plane = (variances[:, 0] < _FLATNESS * variances[:, 1]) & (np.abs(cosines) > _LEAST_COSINE)
    faced: FloatArray = np.where(is_plane[:, None], normals, towards)
    return faced


def surface_slopes(problem: Problem, normals: FloatArray) -> FloatArray:
    """How images of points move as these move on the surface.

    Parameters
    ----------
    problem : Problem
        Of any metric camera model, with M observations of N points, each in front of its cameras.
    normals : (N, 3) float64
        Unit normals of the surface at each point.

    Returns
    -------
    (M, 2, 2) float64
        Derivatives of the image of an observation's point with respect to two coordinates on the surface,
        which are the same in all images of the point [px over the unit of the world].
    """
    in_camera = points_in_cameras(problem, require_points(problem, problem.points))
    depth = in_camera[:, 2, None, None]
    normalised = in_camera[:, :2] / in_camera[:, 2:]
    slopes = image_slopes(normalised, intrinsics_of_observations(problem))
    flat = np.concatenate([np.tile(np.eye(2), (len(depth), 1, 1)), -normalised[:, :, None]], axis=2) / depth
    tangents = _tangents(normals)[problem.point_index]
    rotations = problem.rotations[problem.camera_index]
    return np.asarray(slopes @ flat @ np.swapaxes(rotations, 1, 2) @ tangents)


def _tangents(normals: FloatArray) -> FloatArray:
    """(N, 3, 2) two unit vectors on each plane."""
    axes = np.where(np.abs(normals[:, :1]) < 0.7, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    first = unit(np.cross(normals, axes))
    return np.stack([first, np.cross(normals, first)], axis=2)
