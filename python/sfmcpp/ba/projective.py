"""Projective problems: made from projection matrices, or from metric problems.

Images are normalised isotropically (thesis eq. 4.3): projective matrices are then of one size. The frame of
an image is ``scale, cx, cy``: pixels are ``scale · (x, y) + (cx, cy)``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sfmcpp import _core
from sfmcpp.ba.arrays import core_arrays
from sfmcpp.errors import InvalidArgument
from sfmcpp.model import Metadata, Problem
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import ANY, FloatArray, finite_array, index_array, numbers_below


@checked(projections=(ANY, 3, 4), sigma_px=(ANY,), covariance_px2=(ANY, 2, 2))
def projective_problem(
    projections: ArrayLike,
    points: ArrayLike,
    camera_index: ArrayLike,
    point_index: ArrayLike,
    pixels: ArrayLike,
    *,
    sigma_px: ArrayLike | None = None,
    covariance_px2: ArrayLike | None = None,
    metadata: Metadata | None = None,
) -> Problem:
    """Make the problem of uncalibrated cameras, each image in its normalised frame (thesis eq. 4.3).

    Parameters
    ----------
    projections : (C, 3, 4)
        Projection matrices to pixels, of any scale.
    points : (N, 3) or (N, 4)
        World points, homogeneous ones of any scale.
    camera_index, point_index : (M,) int
        Camera and point of each observation.
    pixels : (M, 2)
        Observed image positions [px].
    sigma_px : (M,), optional
        Their standard deviations [px]; default 1.
    covariance_px2 : (M, 2, 2), optional
        Their covariances [px²], in place of standard deviations.
    metadata : Metadata, optional
        Names, colours and the like.

    Returns
    -------
    Problem
        Of camera model ``"projective"``: each `P` takes to its image's frame ``scale, cx, cy``, in which the
        centroid of the observations is the origin and their mean distance to it √2; `P` and the points
        are of norm one.

    Raises
    ------
    InvalidArgument
        If a shape is wrong, an index is out of range, a pixel is not finite, a matrix or a point is zero or
        not finite, or both `sigma_px` and `covariance_px2` are given.
    """
    matrices = np.asarray(projections)
    homogeneous = _homogeneous(np.asarray(points, dtype=np.float64))
    cameras = index_array("camera_index", camera_index)
    seen = finite_array("pixels", np.zeros((0, 2)) if not np.size(pixels) else pixels, (ANY, 2))
    if len(seen) != len(cameras):
        raise InvalidArgument(f"pixels: {len(seen)} rows for {len(cameras)} observations")
    numbers_below("camera_index", cameras, len(matrices))
    observed = index_array("point_index", point_index)
    numbers_below("point_index", observed, len(homogeneous))
    frames = image_frames(cameras, seen, len(matrices))
    return Problem(
        "projective",
        _unit_rows("projections", matrices_to_frames(matrices, frames)),
        frames,
        _unit_rows("points", homogeneous),
        cameras,
        observed,
        seen,
        sigma_px=None if sigma_px is None else np.asarray(sigma_px, dtype=np.float64),
        covariance_px2=None if covariance_px2 is None else np.asarray(covariance_px2, dtype=np.float64),
        metadata=metadata or Metadata(),
    )


@checked()
def as_projective(problem: Problem) -> Problem:
    """Forget the calibration: the same cameras, points and observations with projection matrices.

    Observations of cameras with distortion are freed of it, with the intrinsics of the present state; their
    standard deviations or covariances stay.

    Parameters
    ----------
    problem : Problem
        Left untouched. A projective one is copied.

    Returns
    -------
    Problem
        Of camera model ``"projective"``. Fixed cameras and points stay fixed; rigs need poses and are left
        out.
    """
    if not problem.is_metric:
        return problem.copy()
    problem = problem.copy()  # of which the result takes arrays and metadata
    result = projective_problem(
        projection_matrices(problem),
        problem.points,
        problem.camera_index,
        problem.point_index,
        _core.undistorted_pixels(core_arrays(problem)),
        sigma_px=problem.sigma_px,
        covariance_px2=problem.covariance_px2,
        metadata=problem.metadata,
    )
    result.fixed_cameras[:] = problem.fixed_cameras
    result.fixed_points[:] = problem.fixed_points
    return result


def projection_matrices(problem: Problem) -> FloatArray:
    """Projection matrices to pixels of all cameras; distortion is left out.

    Parameters
    ----------
    problem : Problem
        Of any camera model.

    Returns
    -------
    (C, 3, 4) float64
        ``K [Rᵀ | −Rᵀc]`` of metric cameras. Projective ones: in pixels instead of the image's frame.
    """
    matrices: FloatArray = _core.projection_matrices(core_arrays(problem))
    return matrices


def _homogeneous(points: FloatArray) -> FloatArray:
    if points.ndim != 2 or points.shape[1] not in (3, 4):
        raise InvalidArgument(f"points: shape {points.shape}, must be (any, 3) or (any, 4)")
    if points.shape[1] == 4:
        return points
    return np.concatenate([points, np.ones((len(points), 1))], axis=1)


def _unit_rows(name: str, values: FloatArray) -> FloatArray:
    flat = values.reshape(len(values), int(np.prod(values.shape[1:])))
    norms = np.linalg.norm(flat, axis=1)
    good = np.isfinite(norms) & (norms > 0)
    if not good.all():
        raise InvalidArgument(f"{name}[{int(np.argmin(good))}]: must be finite and not zero")
    unit: FloatArray = (flat / norms[:, None]).reshape(values.shape)
    return unit


def image_frames(images: NDArray[np.integer], pixels: FloatArray, count: int) -> FloatArray:
    """Frames (count, 3) of images: the mean of the observations of each, and their mean distance over √2.

    Parameters
    ----------
    images : (M,) int
        Image of each observation.
    pixels : (M, 2) float64
        Where it is [px].
    count : int
        Number of images.
    """
    seen = np.maximum(np.bincount(images, minlength=count), 1)
    centres = np.stack([np.bincount(images, pixels[:, k], count) / seen for k in (0, 1)], axis=1)
    distances = np.linalg.norm(pixels - centres[images], axis=1)
    scale = np.bincount(images, distances, count) / (seen * np.sqrt(2.0))
    return np.concatenate([np.where(scale > 0, scale, 1.0)[:, None], centres], axis=1)


def matrices_to_pixels(matrices: FloatArray, frames: FloatArray) -> FloatArray:
    """Projection matrices (C, 3, 4) to the frames of the images as matrices to pixels."""
    scale, centre = frames[:, 0, None, None], frames[:, 1:, None]
    return np.concatenate([scale * matrices[:, :2] + centre * matrices[:, 2:], matrices[:, 2:]], axis=1)


def matrices_to_frames(matrices: FloatArray, frames: FloatArray) -> FloatArray:
    """Projection matrices (C, 3, 4) to pixels as matrices to the frames of the images."""
    scale, centre = frames[:, 0, None, None], frames[:, 1:, None]
    return np.concatenate([(matrices[:, :2] - centre * matrices[:, 2:]) / scale, matrices[:, 2:]], axis=1)
