"""Least-squares rigid and similarity alignment of two sets of corresponding points (Umeyama 1991)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.geometry.point_moments import PointMoments
from sfmcpp.geometry.so3 import nearest_rotation
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.checks import require_not_negative

# Unit vectors are opposite where their sum is this short: its direction is lost in rounding.
_OPPOSITE = 1e-8


@dataclass(frozen=True)
class Alignment:
    """The transform ``target = scale · rotation · source + translation`` nearest to the data.

    Attributes
    ----------
    scale : float
        One for a rigid alignment.
    rotation : (3, 3) float64
        Rotation target_from_source.
    translation : (3,) float64
        Image of the source's origin.
    rms : float
        Root of the weighted mean squared distance that is left, in units of the target.
    undetermined : str
        What the points do not determine: nothing if empty, or ``"rotation about a line"`` (points on a
        line), or ``"rotation and scale"`` (all at one place). The values returned are then, of all that fit
        equally well, those of the smallest rotation, and scale one where that is open.
    """

    scale: float
    rotation: FloatArray
    translation: FloatArray
    rms: float
    undetermined: str

    def apply(self, points: ArrayLike) -> FloatArray:
        """Take points from source to target.

        Parameters
        ----------
        points : (..., 3) float64
            Points in the source's frame.

        Returns
        -------
        (..., 3) float64
        """
        return np.asarray(self.scale * (np.asarray(points) @ self.rotation.T) + self.translation)

    def apply_to_cameras(self, cameras: ArrayLike) -> FloatArray:
        """Take camera poses from source to target.

        Parameters
        ----------
        cameras : (..., 3, 4) float64
            ``[R | c]``, world_from_camera, in the source's frame.

        Returns
        -------
        (..., 3, 4) float64
        """
        poses = np.asarray(cameras, dtype=np.float64)
        centres = self.apply(poses[..., 3])
        return np.concatenate([self.rotation @ poses[..., :3], centres[..., None]], axis=-1)


def align_similarity(
    source: ArrayLike, target: ArrayLike, weights: ArrayLike | None = None, *, collinear_ratio: float = 1e-9
) -> Alignment:
    """Find the similarity that takes `source` nearest to `target`, in the mean of squared distances.

    Parameters
    ----------
    source, target : (N, 3) float64
        Corresponding points, N ≥ 1.
    weights : (N,) float64, optional
        Weight of each squared distance, not negative, not all zero. Default: equal.
    collinear_ratio : float
        Points lie on a line where their second spread is at most this part of the first, in either set.

    Returns
    -------
    Alignment

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a number is not finite or out of its range.
    """
    return _align(source, target, weights, collinear_ratio, free_scale=True)


def align_rigid(
    source: ArrayLike, target: ArrayLike, weights: ArrayLike | None = None, *, collinear_ratio: float = 1e-9
) -> Alignment:
    """Find the rotation and translation that take `source` nearest to `target`; see :func:`align_similarity`.

    Parameters
    ----------
    source, target : (N, 3) float64
        Corresponding points, N ≥ 1.
    weights : (N,) float64, optional
        Weight of each squared distance, not negative, not all zero. Default: equal.
    collinear_ratio : float
        Points lie on a line where their second spread is at most this part of the first, in either set.

    Returns
    -------
    Alignment
        Of scale one.

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a number is not finite or out of its range.
    """
    return _align(source, target, weights, collinear_ratio, free_scale=False)


def _align(
    source: ArrayLike,
    target: ArrayLike,
    weights: ArrayLike | None,
    collinear_ratio: float,
    *,
    free_scale: bool,
) -> Alignment:
    require_not_negative("collinear_ratio", collinear_ratio)
    moments = PointMoments.of(source, target, weights)
    extents = (moments.source_extents, moments.target_extents)
    dimension = min(_dimension(extent, collinear_ratio) for extent in extents)
    rotation = _rotation(moments.covariance, dimension)
    scale = moments.scale(rotation) if free_scale and dimension else 1.0
    translation = moments.translation(rotation, scale)
    undetermined = ("rotation and scale", "rotation about a line", "")[dimension]
    found = Alignment(scale, rotation, translation, 0.0, undetermined)
    distances = np.linalg.norm(found.apply(source) - np.asarray(target), axis=1)
    return replace(found, rms=float(np.sqrt(moments.shares @ distances**2)))


def _dimension(extents: FloatArray, collinear_ratio: float) -> int:
    """0 for points at one place, 1 on a line, 2 otherwise."""
    if extents[0] == 0:
        return 0
    return 1 if extents[1] <= collinear_ratio * extents[0] else 2


def _rotation(covariance: FloatArray, dimension: int) -> FloatArray:
    """Rotation R of largest trace(Rᵀ · covariance), the smallest of several."""
    if dimension == 0:
        return np.eye(3)
    if dimension == 2:
        return nearest_rotation(covariance)
    u, _, vt = np.linalg.svd(covariance)
    return _smallest_rotation(vt[0], u[:, 0])


def _smallest_rotation(source: FloatArray, target: FloatArray) -> FloatArray:
    """Rotation by the smallest angle that takes one unit vector to another: a product of two reflections."""
    between = source + target
    if np.linalg.norm(between) < _OPPOSITE:
        between = np.eye(3)[np.argmin(np.abs(source))]
        between = between - (between @ source) * source
    half_turn = 2 * np.outer(between, between) / (between @ between) - np.eye(3)
    return np.asarray(half_turn @ (2 * np.outer(source, source) - np.eye(3)))
